"""Metrics as Prometheus's own parser reads them."""

from __future__ import annotations

from prometheus_client.parser import text_string_to_metric_families

from service.telemetry import Telemetry


def parsed(page: str) -> dict[tuple[object, ...], float]:
    """Value of each sample, by its name and its labels in order."""
    return {
        (sample.name, *sorted(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(page)
        for sample in family.samples
    }


def samples(telemetry: Telemetry) -> dict[tuple[object, ...], float]:
    """As `parsed`, of what is measured now."""
    return parsed(telemetry.metrics.page()[0].decode())
