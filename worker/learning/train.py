"""Clouds -> shape model: the method at training time, one call a stage."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from service.engine.cloud import PointCloud
from service.engine.dictionary import Dictionary
from service.engine.errors import InvalidCloud, NotEnoughSamples
from service.engine.model import ShapeModel
from service.engine.motifs import Ensemble
from service.engine.params import ModelParams, StimuliParams
from service.engine.perception import OnStage, Perception, ignore_stage, perceive
from service.engine.prototypes import Prototypes
from service.engine.stimuli import Stimuli, stimulate
from worker.learning.concepts import learn_metric
from worker.learning.dictionary import learn_dictionary
from worker.learning.filtration import filtrate
from worker.learning.hierarchy import grow_ensemble
from worker.learning.prototypes import draw_map, draw_thumbnail
from worker.learning.space import build_space

BATCH = 8  # objects that a worker process takes at a time


class NamedCloud(NamedTuple):
    """A training cloud and what it is called."""

    key: str
    cloud: PointCloud


class Trained(NamedTuple):
    """A model, and the clouds that could not be learnt from: each one's name and what is wrong with it."""

    model: ShapeModel
    refused: tuple[tuple[str, InvalidCloud], ...]


def train(
    clouds: Iterable[NamedCloud], params: ModelParams, seed: int = 0, on_stage: OnStage = ignore_stage
) -> Trained:
    """Learns dictionary, hierarchy ensemble and concepts from clouds.

    The work is shared out as `joblib.parallel_config` says; the model is the same, bit for bit, on any number of
    workers.

    Args:
        clouds: of one object each, in an order that is part of the input.
        params: of every stage.
        seed: of the map's embedding, the only random draw of learning.
        on_stage: called as each stage begins.

    Raises:
        NotEnoughSamples: fewer than two clouds can be described.
    """
    on_stage("segments and descriptors")
    named, perceptions, refused = _perceive_all(clouds, params)

    with threadpool_limits(1):  # sums of the linear algebra must not depend on the number of threads
        on_stage("dictionary")
        dictionary = learn_dictionary(np.concatenate([p.segment_descriptors for p in perceptions]), params.dictionary)

        on_stage("motif hierarchies")
        ensemble = grow_ensemble(perceptions, dictionary)

    on_stage("stimuli")
    stimuli = _stimulate_all(perceptions, dictionary, ensemble, params.stimuli)

    with threadpool_limits(1):
        on_stage("topological space")
        space = build_space(stimuli)

        on_stage("filtration")
        filtration, notes = filtrate(space, params.filtration)

        on_stage("concepts")
        metric = learn_metric(stimuli, params.response)

        on_stage("map")
        prototypes = Prototypes(
            cloud_keys=tuple(key for key, _ in named),
            cloud_hashes=tuple(digest for _, digest in named),
            thumbnails=np.stack([draw_thumbnail(p.graph) for p in perceptions]),
            map=draw_map(metric.embed(stimuli), seed),
        )
    return Trained(
        ShapeModel(params, dictionary, ensemble, stimuli, space, filtration, metric, prototypes, notes), refused
    )


_Seen = tuple[str, str, Perception | InvalidCloud]


def _perceive_all(
    clouds: Iterable[NamedCloud], params: ModelParams
) -> tuple[list[tuple[str, str]], list[Perception], tuple[tuple[str, InvalidCloud], ...]]:
    """Name and hash of each cloud, its perception, and the clouds that were refused."""
    seen: list[_Seen] = Parallel(batch_size=BATCH)(delayed(_perceive)(named, params) for named in clouds)
    good = [(key, digest, result) for key, digest, result in seen if isinstance(result, Perception)]
    refused = tuple((key, result) for key, _, result in seen if isinstance(result, InvalidCloud))
    if len(good) < 2:
        why = f" The first that was refused, {refused[0][0]}: {refused[0][1]}" if refused else ""
        raise NotEnoughSamples(f"Learning needs at least 2 clouds that can be described; there are {len(good)}.{why}")
    return [(key, digest) for key, digest, _ in good], [result for _, _, result in good], refused


def _perceive(named: NamedCloud, params: ModelParams) -> _Seen:
    digest = hashlib.sha256(np.ascontiguousarray(named.cloud.points).tobytes()).hexdigest()
    with threadpool_limits(1):
        try:
            return named.key, digest, perceive(named.cloud, params)
        except InvalidCloud as error:
            return named.key, digest, error


def _stimulate_all(
    perceptions: Sequence[Perception], dictionary: Dictionary, ensemble: Ensemble, params: StimuliParams
) -> csr_array:
    """The stimuli vectors of the training objects themselves (N, V), float32: all that follows learns from these."""
    batches = [perceptions[i : i + BATCH] for i in range(0, len(perceptions), BATCH)]
    results: list[list[Stimuli]] = Parallel()(
        delayed(_stimulate)(batch, dictionary, ensemble, params) for batch in batches
    )
    rows = [row for batch in results for row in batch]
    indptr = np.cumsum([0, *(len(row.indices) for row in rows)], dtype=np.int64)
    data = np.concatenate([row.values for row in rows])
    indices = np.concatenate([row.indices for row in rows])
    return csr_array((data, indices, indptr), shape=(len(rows), ensemble.vertex_count))


def _stimulate(
    perceptions: Sequence[Perception], dictionary: Dictionary, ensemble: Ensemble, params: StimuliParams
) -> list[Stimuli]:
    with threadpool_limits(1):
        return [
            stimulate(ensemble, p.constellations, p.descriptors, dictionary.words(p.segment_descriptors), params)
            for p in perceptions
        ]
