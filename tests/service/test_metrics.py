"""Distributions are told as the library's own histograms are."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from prometheus_client import CollectorRegistry, Histogram, generate_latest

from service.metrics import SECONDS, Distribution
from tests.service.measured import parsed

VALUES = [*np.random.default_rng(3).exponential(0.1, 200), 0.0, *SECONDS, 1e9]  # bounds themselves are within


def test_a_distribution_is_what_the_librarys_histogram_would_be() -> None:
    own, theirs = CollectorRegistry(), CollectorRegistry()
    distribution = Distribution("spent", "time", ("wire", "stage"), SECONDS, own)
    histogram = Histogram("spent", "time", ("wire", "stage"), buckets=SECONDS, registry=theirs)
    for number, value in enumerate(VALUES):
        labels = ("rest" if number % 3 else "grpc", "decode")
        distribution.observe(value, *labels)
        histogram.labels(*labels).observe(value)
    expected = {name: value for name, value in told(theirs).items() if name[0] != "spent_created"}
    assert told(own) == expected


def test_one_without_labels_is_told_before_anything_was_seen() -> None:
    registry = CollectorRegistry()
    Distribution("spent", "time", (), SECONDS, registry)
    assert told(registry)["spent_count",] == 0


def test_no_observation_of_many_threads_is_lost() -> None:
    registry = CollectorRegistry()
    distribution = Distribution("spent", "time", ("wire",), SECONDS, registry)

    def observe(number: int) -> None:
        for _ in range(500):
            distribution.observe(1.0, str(number % 2))

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(observe, range(8)))
    assert {told(registry)["spent_count", ("wire", wire)] for wire in "01"} == {2000}
    assert {told(registry)["spent_sum", ("wire", wire)] for wire in "01"} == {2000}


def told(registry: CollectorRegistry) -> dict[tuple[object, ...], float]:
    return parsed(generate_latest(registry).decode())
