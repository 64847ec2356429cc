"""What is counted and timed, for Prometheus. Labels are words of ours and names in the store, never a client's text.

The library, which takes its time to import and to count, is asked for when somebody wants to see the metrics.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

from service import __version__

if TYPE_CHECKING:
    from prometheus_client.core import Metric

SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
PREFIX = "shape_concepts"


class State(NamedTuple):
    """How the service stands at a moment.

    Attributes:
        at_work: requests whose clouds are being answered.
        waiting: requests that wait for a worker.
        places: how many requests may be at work and waiting.
        held: bytes of all requests in memory.
        limit: how many bytes there may be.
        loaded: names and versions of the models in memory.
        serving: the version that each model and alias means here now.
    """

    at_work: int
    waiting: int
    places: int
    held: int
    limit: int
    loaded: Sequence[tuple[str, int]]
    serving: Mapping[tuple[str, str], int]


class Tally:
    """How many, by labels.

    Args:
        name: of the metric.
        told: what it is.
        labels: their names.
        falls: whether it may become less.
    """

    def __init__(self, name: str, told: str, labels: Sequence[str], *, falls: bool = False) -> None:
        self._name, self._told, self._labels, self._falls = name, told, labels, falls
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, ...], int] = {}

    def add(self, count: int, *labels: str) -> None:
        """Adds to the count."""
        with self._lock:
            self._counts[labels] = self._counts.get(labels, 0) + count

    def family(self) -> Metric:
        """What was counted until now, as the library has it."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        kind = GaugeMetricFamily if self._falls else CounterMetricFamily
        family = kind(self._name, self._told, labels=self._labels)
        with self._lock:
            counts = list(self._counts.items())
        for labels, count in counts:
            family.add_metric(labels, count)
        return family


class Distribution:
    """How often values fell into which bucket. An answer makes a dozen observations, of a microsecond each.

    Args:
        name: of the metric.
        told: what it is.
        labels: their names.
        bounds: upper bounds of the buckets, ascending; one without a bound follows.
    """

    def __init__(self, name: str, told: str, labels: Sequence[str], bounds: Sequence[float]) -> None:
        self._name, self._told, self._labels, self._bounds = name, told, labels, bounds
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, ...], list[int]] = {}
        self._sums: dict[tuple[str, ...], float] = {}
        if not labels:
            self._open(())

    def observe(self, value: float, *labels: str) -> None:
        """Counts a value, in the unit that the metric's name has."""
        place = bisect_left(self._bounds, value)
        with self._lock:
            counts = self._counts.get(labels) or self._open(labels)
            counts[place] += 1
            self._sums[labels] += value

    def _open(self, labels: tuple[str, ...]) -> list[int]:
        self._sums[labels] = 0.0
        return self._counts.setdefault(labels, [0] * (len(self._bounds) + 1))

    def family(self) -> Metric:
        """What was counted until now, as the library has it."""
        from prometheus_client.core import HistogramMetricFamily
        from prometheus_client.utils import floatToGoString

        family = HistogramMetricFamily(self._name, self._told, labels=self._labels)
        with self._lock:
            seen = [(labels, list(counts), self._sums[labels]) for labels, counts in self._counts.items()]
        names = [*(floatToGoString(bound) for bound in self._bounds), "+Inf"]
        for labels, counts, total in seen:
            family.add_metric(labels, list(zip(names, accumulate(counts), strict=True)), total)
        return family


class Metrics:
    """The metrics of one service; each has its own, however many are in one process."""

    def __init__(self) -> None:
        self.requests = Tally(
            f"{PREFIX}_requests",
            "Requests that ended, by outcome: ok, or the name of the error",
            ("wire", "operation", "outcome"),
        )
        self.durations = Distribution(
            f"{PREFIX}_request_seconds", "From a request's arrival to its end", ("wire", "operation"), SECONDS
        )
        self.under_way = Tally(f"{PREFIX}_requests_under_way", "Requests that have not ended", ("wire",), falls=True)
        self.stages = Distribution(
            f"{PREFIX}_stage_seconds", "Stages of answers, as in their timings_ms", ("wire", "stage"), SECONDS
        )
        self.waits = Distribution(f"{PREFIX}_wait_seconds", "From a request's admission to its work", (), SECONDS)
        self.novelty = Distribution(f"{PREFIX}_novelty", "Novelty of answered clouds, 0 to 1", (), SHARES)
        self.drops = Tally(f"{PREFIX}_dropped", "Clouds of streams that newer ones have overtaken", ("wire",))
        self._info = Tally(f"{PREFIX}_info", "1; says which version of the software this is", ("version",), falls=True)
        self._info.add(1, __version__)
        self._state: Callable[[], State] | None = None

    def watch(self, state: Callable[[], State]) -> None:
        """Has the state of the service read whenever metrics are asked for."""
        self._state = state

    def page(self, accept: str = "") -> tuple[bytes, str]:
        """All metrics, and their media type.

        Args:
            accept: the media types that the client would take, as HTTP's header of that name says.
        """
        return expose(self._families(), accept)

    def _families(self) -> Iterator[Metric]:
        from prometheus_client import ProcessCollector

        for metric in (self.requests, self.durations, self.under_way, self.stages):
            yield metric.family()
        for metric in (self.waits, self.novelty, self.drops, self._info):
            yield metric.family()
        yield from ProcessCollector(registry=None).collect()
        if self._state is not None:
            yield from _levels(self._state())


def expose(families: Iterable[Metric], accept: str = "") -> tuple[bytes, str]:
    """Metrics as text, and its media type, by the media types that a client would take."""
    from prometheus_client import CollectorRegistry
    from prometheus_client.exposition import choose_encoder
    from prometheus_client.registry import Collector

    class Told(Collector):
        def describe(self) -> list[Metric]:
            return []

        def collect(self) -> Iterable[Metric]:
            return families

    registry = CollectorRegistry()
    registry.register(Told())
    try:
        encode, media_type = choose_encoder(accept)
    except (TypeError, ValueError):  # the library stumbles over versions that are none
        encode, media_type = choose_encoder("")
    return encode(registry), media_type


def _levels(state: State) -> Iterator[Metric]:
    """What is looked up at the moment of asking."""
    from prometheus_client.core import GaugeMetricFamily

    levels = {
        "queue_at_work": ("Requests whose clouds are being answered", state.at_work),
        "queue_waiting": ("Requests that wait for a worker", state.waiting),
        "queue_places": ("Requests that may be at work and waiting", state.places),
        "intake_bytes": ("Bytes of all requests in memory", state.held),
        "intake_limit_bytes": ("Bytes of requests that there may be in memory", state.limit),
    }
    for name, (told, value) in levels.items():
        yield GaugeMetricFamily(f"{PREFIX}_{name}", told, value)
    loaded = GaugeMetricFamily(
        f"{PREFIX}_model_loaded", "1 for each version of a model in memory", labels=("model", "version")
    )
    for name, version in state.loaded:
        loaded.add_metric((name, str(version)), 1)
    yield loaded
    serving = GaugeMetricFamily(
        f"{PREFIX}_model_version", "Version that an alias of a model means now", labels=("model", "alias")
    )
    for (name, alias), version in state.serving.items():
        serving.add_metric((name, alias), version)
    yield serving
