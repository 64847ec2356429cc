"""Distributions are told as the library's own histograms are."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from prometheus_client import CollectorRegistry, Histogram, generate_latest

from service.metrics import SECONDS, Distribution, Metrics, Tally, expose
from tests.service.measured import parsed

VALUES = [*np.random.default_rng(3).exponential(0.1, 200), 0.0, *SECONDS, 1e9]  # bounds themselves are within


def test_a_distribution_is_what_the_librarys_histogram_would_be() -> None:
    theirs = CollectorRegistry()
    distribution = Distribution("spent", "time", ("wire", "stage"), SECONDS)
    histogram = Histogram("spent", "time", ("wire", "stage"), buckets=SECONDS, registry=theirs)
    for number, value in enumerate(VALUES):
        labels = ("rest" if number % 3 else "grpc", "decode")
        distribution.observe(value, *labels)
        histogram.labels(*labels).observe(value)
    their = parsed(generate_latest(theirs).decode())
    expected = {name: value for name, value in their.items() if name[0] != "spent_created"}
    assert told(distribution) == expected


def test_one_without_labels_is_told_before_anything_was_seen() -> None:
    assert told(Distribution("spent", "time", (), SECONDS))["spent_count",] == 0


def test_no_observation_of_many_threads_is_lost() -> None:
    distribution, tally = Distribution("spent", "time", ("wire",), SECONDS), Tally("seen", "how often", ("wire",))

    def observe(number: int) -> None:
        for _ in range(500):
            distribution.observe(1.0, str(number % 2))
            tally.add(1, str(number % 2))

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(observe, range(8)))
    assert {told(distribution)["spent_count", ("wire", wire)] for wire in "01"} == {2000}
    assert {told(distribution)["spent_sum", ("wire", wire)] for wire in "01"} == {2000}
    assert {told(tally)["seen_total", ("wire", wire)] for wire in "01"} == {2000}


def told(metric: Distribution | Tally) -> dict[tuple[object, ...], float]:
    return parsed(expose([metric.family()])[0].decode())


@pytest.mark.parametrize(
    "accept", ["", "application/openmetrics-text; version=x.y", "text/plain;version=1.a", "\xff;;,"]
)
def test_metrics_are_told_whatever_a_client_says_it_takes(accept: str) -> None:
    page, media_type = Metrics().page(accept)
    assert b"shape_concepts_info" in page
    assert media_type
