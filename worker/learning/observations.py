"""What learning keeps of each training cloud; the clouds themselves are let go one by one."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.engine.errors import InvalidCloud
from service.engine.motifs import Constellations
from service.engine.params import ModelParams
from service.engine.perception import perceive
from worker.learning.prototypes import draw_thumbnail
from worker.learning.single import one_thread

ROUND = 64  # clouds in memory at a time, at least
EACH = 8  # or as many for each worker
UNMADE = 4  # times as many where clouds are only made where they are described
BYTES = 256 * 2**20  # but of points no more than these, and a cloud


class NamedCloud(NamedTuple):
    """A training cloud and what it is called."""

    key: str
    cloud: PointCloud


class Unmade(Protocol):
    """A training cloud that is not there yet: small, and to be pickled in its stead."""

    @property
    def key(self) -> str:
        """What it is called."""

    @property
    def cloud(self) -> PointCloud:
        """Makes it."""


@dataclass(frozen=True)
class Observation:
    """A training object as the method saw it.

    Attributes:
        key: what its cloud is called.
        digest: SHA-256 of the cloud's points, in hexadecimal.
        constellations: C of them; the first S are the single segments.
        descriptors: (C, D) float32, of the constellations.
        thumbnail: (48, 48) uint8.
    """

    key: str
    digest: str
    constellations: Constellations
    descriptors: NDArray[np.float32]
    thumbnail: NDArray[np.uint8]

    @property
    def segment_descriptors(self) -> NDArray[np.float32]:
        """(S, D): what visual words are made of."""
        return self.descriptors[: self.constellations.members.shape[1]]


class Refusal(NamedTuple):
    """A training cloud that cannot be described, and why."""

    key: str
    error: InvalidCloud


def observe(clouds: Iterable[NamedCloud | Unmade], params: ModelParams) -> Iterator[Observation | Refusal]:
    """Perceives clouds, in their order, on as many workers as `joblib.parallel_config` says."""
    for batch in _rounds(clouds):
        yield from Parallel()(delayed(observe_one)(named, params) for named in batch)


def _rounds(clouds: Iterable[NamedCloud | Unmade]) -> Iterator[list[NamedCloud | Unmade]]:
    """The clouds that are in memory at a time."""
    most = max(ROUND, EACH * effective_n_jobs())
    batch: list[NamedCloud | Unmade] = []
    size = 0.0
    for named in clouds:
        batch.append(named)
        made = isinstance(named, NamedCloud)
        size += max(1 / most, named.cloud.points.nbytes / BYTES) if made else 1 / (UNMADE * most)
        if size >= 1 - 1e-9:
            yield batch
            batch, size = [], 0.0
    if batch:
        yield batch


def observe_one(named: NamedCloud | Unmade, params: ModelParams) -> Observation | Refusal:
    """Perceives a cloud."""
    cloud = named.cloud
    digest = hashlib.sha256(np.ascontiguousarray(cloud.points).tobytes()).hexdigest()
    with one_thread():
        try:
            seen = perceive(cloud, params)
        except InvalidCloud as error:
            return Refusal(named.key, error)
    return Observation(named.key, digest, seen.constellations, seen.descriptors, draw_thumbnail(seen.graph))
