"""What learning and answering share."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.params import ModelParams
from service.engine.perception import perceive
from tests.learnt import PRESETS, named_clouds
from tests.shapes import ball, box, corner_view, look, see


@pytest.mark.parametrize("preset", PRESETS)
def test_every_constellation_is_described_once_in_the_order_of_its_members(preset: str):
    for named in named_clouds()[:4]:
        seen = perceive(named.cloud, ModelParams.preset(preset))
        assert len(seen.descriptors) == len(seen.constellations.members)
        assert np.array_equal(seen.segment_descriptors, seen.descriptors[: seen.graph.count])
        assert np.array_equal(seen.constellations.members[: seen.graph.count], np.eye(seen.graph.count, dtype=bool))


def test_a_box_is_three_segments_in_seven_constellations_and_a_ball_is_one():
    seen = perceive(see(box(0.1, 0.15, 0.22), corner_view(0, 0.9)).cloud, ModelParams())
    assert seen.graph.count == 3
    assert len(seen.descriptors) == 7
    alone = perceive(see(ball(0.07), look(0, 30, 0.9)).cloud, ModelParams())
    assert alone.constellations.members.tolist() == [[True]]


def test_warnings_of_the_cloud_come_along():
    cloud = see(box(0.1, 0.15, 0.22), corner_view(0, 0.9)).cloud
    moved = type(cloud)(cloud.points - cloud.points.mean(axis=0))
    assert perceive(cloud, ModelParams()).warnings == ()
    assert "viewpoint" in perceive(moved, ModelParams()).warnings[0]


def test_stages_are_told_before_they_begin():
    told: list[str] = []
    perceive(named_clouds()[0].cloud, ModelParams(), told.append)
    assert told == ["normalise", "patches", "segments", "constellations", "descriptors"]
