"""The stimuli of the training objects themselves, on as many workers as `joblib.parallel_config` says.

On one machine these are threads: nearly all is done in compiled code, which lets others run, and nothing need be sent.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Sequence

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from joblib.parallel import get_active_backend
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.dictionary import Dictionary
from service.engine.motifs import Ensemble
from service.engine.params import StimuliParams
from service.engine.stimuli import Stimuli, stimulate
from worker.learning.observations import Observation
from worker.learning.single import one_thread

BATCH = 8  # objects whose stimuli a worker computes at a time

Learnt = tuple[Dictionary, Ensemble]


def stimulate_all(
    objects: Sequence[Observation], dictionary: Dictionary, ensemble: Ensemble, params: StimuliParams
) -> csr_array:
    """The stimuli vectors of the training objects (N, V), float32: all that follows learns from these."""
    batches = (objects[i : i + BATCH] for i in range(0, len(objects), BATCH))
    if not _elsewhere():
        tasks = (delayed(_stimulate)(batch, (dictionary, ensemble), params) for batch in batches)
        threads = Parallel(backend="threading", n_jobs=effective_n_jobs(), return_as="generator")
        return stack((row for batch in threads(tasks) for row in batch), ensemble.vertex_count)
    data = pickle.dumps((dictionary, ensemble), protocol=5)
    packed, digest = np.frombuffer(data, dtype=np.uint8), hashlib.sha256(data).hexdigest()
    results = Parallel(return_as="generator")(delayed(_unpack)(batch, packed, digest, params) for batch in batches)
    try:
        return stack((row for batch in results for row in batch), ensemble.vertex_count)
    finally:
        _unpacked.clear()


def stack(rows: Iterable[Stimuli], vertices: int) -> csr_array:
    """Stimuli vectors of N objects as the rows of a sparse matrix (N, V)."""
    given = list(rows)
    indptr = np.cumsum([0, *(len(row.indices) for row in given)], dtype=np.int64)
    if indptr[-1] <= np.iinfo(np.int32).max:  # else all indices would be of 64 bits
        indptr = indptr.astype(np.int32)
    data = np.concatenate([row.values for row in given])
    indices = np.concatenate([row.indices for row in given])
    return csr_array((data, indices, indptr), shape=(len(given), vertices))


_unpacked: dict[str, Learnt] = {}
"""What this process unpacked last, by its digest: once for all batches, and prepared once to be compared with."""


def _elsewhere() -> bool:
    """Whether work goes to other machines: there are clients of a cluster alone."""
    backend, _ = get_active_backend()
    return hasattr(backend, "client")


def _unpack(
    objects: Sequence[Observation], packed: NDArray[np.uint8], digest: str, params: StimuliParams
) -> list[Stimuli]:
    """A large array goes to each machine once, however many batches there are: so what all need comes as one."""
    learnt = _unpacked.get(digest)
    if learnt is None:
        learnt = pickle.loads(packed.data)
        _unpacked.clear()
        _unpacked[digest] = learnt
    return _stimulate(objects, learnt, params)


def _stimulate(objects: Sequence[Observation], learnt: Learnt, params: StimuliParams) -> list[Stimuli]:
    dictionary, ensemble = learnt
    with one_thread():
        return [
            stimulate(ensemble, o.constellations, o.descriptors, dictionary.words(o.segment_descriptors), params)
            for o in objects
        ]
