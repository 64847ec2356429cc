"""What is drawn of a cloud: its own points, in colours that tell what its answer says."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from service.answer import Answer
from service.application import Application
from service.clouds import SceneCloud, Viewpoint
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.pictures.colours import ABSENT, colour, parts, scale
from service.pictures.learnt import Learnt
from service.pictures.picture import MOST_POINTS, Picture, draw_cloud, draw_scene
from tests.service.tabletop.seen import set_table


def drawn(application: Application, sent: SceneCloud) -> Picture:
    answer = application.respond(sent.cloud, explain=True, segments=True)
    return draw_cloud("mug.ply", sent, answer, *tells(application, answer))


def tells(application: Application, answer: Answer) -> tuple[Callable, Callable]:
    return (
        lambda told: learnt(application, told),
        lambda number: application.looking.thumbnail(answer.model, answer.version, number),
    )


def learnt(application: Application, answer: Answer) -> Learnt:
    which = (answer.model, answer.version)
    return Learnt(application.models.concepts(*which, answer.time), application.models.annexations(*which))


def by(picture: Picture) -> dict[str, list[str]]:
    """The label of each point, by what colours it."""
    return {
        each.by: [each.labels[place] for place in each.values] for each in picture.colourings if each.by != "height"
    }


def test_each_point_has_the_colour_of_its_segment(application: Application, clouds: list[PointCloud]) -> None:
    answer = application.respond(clouds[0], explain=True, segments=True)
    picture = draw_cloud("mug.ply", SceneCloud(clouds[0]), answer, *tells(application, answer))
    assert picture.of == len(clouds[0].points)
    assert len(picture.points) == min(picture.of, MOST_POINTS)
    assert answer.point_segments is not None
    place = {point.tobytes(): segment for point, segment in zip(clouds[0].points, answer.point_segments, strict=True)}
    assert [place[point.tobytes()] for point in picture.points] == picture.segments.tolist()
    for label, segment in zip(by(picture)["segment"], picture.segments.tolist(), strict=True):
        assert label.startswith(f"segment {segment}," if segment >= 0 else "no segment")


def test_words_and_concepts_are_those_of_the_segments(application: Application, clouds: list[PointCloud]) -> None:
    answer = application.respond(clouds[1], explain=True, segments=True)
    picture = draw_cloud("mug.ply", SceneCloud(clouds[1]), answer, *tells(application, answer))
    assert answer.explanation is not None
    listed = application.models.concepts(answer.model, answer.version, answer.time).concepts
    labels = by(picture)
    for k, segment in enumerate(picture.segments.tolist()):
        if segment < 0:
            assert (labels["word"][k], labels["concept"][k]) == ("no word", "no concept")
            continue
        told = answer.explanation.segments[segment]
        own = [f"concept {concept.id}" for concept in listed if told.nearest[0].object in concept.objects]
        assert labels["word"][k] == f"word {told.words[-1]}"
        assert labels["concept"][k] == (own or ["no concept"])[0]


def test_points_that_were_not_measured_are_not_drawn(application: Application, clouds: list[PointCloud]) -> None:
    measured = np.zeros(2 * len(clouds[0].points), bool)
    measured[::2] = True
    whole = drawn(application, SceneCloud(clouds[0]))
    holed = drawn(application, SceneCloud(PointCloud(clouds[0].points, measured)))
    np.testing.assert_array_equal(holed.points, whole.points)
    np.testing.assert_array_equal(holed.segments, whole.segments)


def test_a_large_cloud_is_thinned_for_display_alone(application: Application, clouds: list[PointCloud]) -> None:
    rng = np.random.default_rng(1)
    many = np.concatenate([clouds[0].points] * (MOST_POINTS // len(clouds[0].points) + 2))
    many += rng.normal(0, 1e-4, many.shape).astype(np.float32)
    picture, again = (drawn(application, SceneCloud(PointCloud(many))) for _ in range(2))
    assert (len(picture.points), picture.of) == (MOST_POINTS, len(many))
    assert picture.answer is not None
    assert picture.answer.point_segments is not None
    assert len(picture.answer.point_segments) == len(many)
    np.testing.assert_array_equal(picture.points, again.points)
    np.testing.assert_allclose(picture.points.mean(axis=0), many.mean(axis=0), atol=0.002)


def test_height_rises_against_the_cameras_y(application: Application, clouds: list[PointCloud]) -> None:
    picture = drawn(application, SceneCloud(clouds[0]))
    height = picture.colourings[-1]
    assert height.by == "height"
    order = np.argsort(picture.points[:, 1])
    assert (np.diff(height.values[order].astype(int)) <= 0).all()
    assert {height.values.min(), height.values.max()} == {0, len(height.colours) - 1}


@pytest.mark.parametrize("pose", [Viewpoint(), Viewpoint((0.3, -1, 2), (0.5, 0.5, 0.5, 0.5))])
def test_a_scene_has_a_picture_of_the_whole_and_one_of_each_object(application: Application, pose: Viewpoint) -> None:
    seen = set_table()
    sent = SceneCloud(seen.cloud, pose)
    answer = application.respond_scene(sent, explain=True, segments=True)
    first = answer.objects[0].answer
    assert first is not None
    whole, *objects = draw_scene("table.pcd", sent, answer, *tells(application, first))
    assert whole.answer is None
    assert [picture.title for picture in objects] == [f"table.pcd, object {k}" for k in range(len(answer.objects))]
    assert [picture.of for picture in objects] == [one.points for one in answer.objects]
    lowest = [picture.points[:, 1].max() for picture in objects]  # y is down: all stand on one table
    np.testing.assert_allclose(lowest, answer.plane.sensor_height_m, atol=0.02)
    for picture, one in zip(objects, answer.objects, strict=True):
        assert one.answer is not None
        assert one.answer.point_segments is not None
        assert (
            np.bincount(picture.segments + 1).tolist() == np.bincount(np.array(one.answer.point_segments) + 1).tolist()
        )


def test_an_object_that_could_not_be_answered_is_drawn_with_the_reason(application: Application) -> None:
    sent = SceneCloud(set_table().cloud)
    answer = application.respond_scene(sent, explain=True, segments=True)
    first = answer.objects[0].answer
    assert first is not None
    refused = answer.objects[1].model_copy(update={"answer": None, "error": {"type": "x", "detail": "it is too flat"}})
    again = type(answer).model_validate(
        answer.model_dump() | {"objects": [answer.objects[0].model_dump(), refused.model_dump(warnings=False)]}
    )
    *_, picture = draw_scene("table.pcd", sent, again, *tells(application, first))
    assert (picture.answer, picture.notes) == (None, ("Not answered: it is too flat",))


def test_of_an_answers_time_the_closest_concept_has_the_whole_bar_and_the_farthest_none(
    application: Application, clouds: list[PointCloud]
) -> None:
    answer = application.respond(clouds[0])
    known = learnt(application, answer)
    bars = known.closeness(answer)
    assert all(0 <= bar <= 1 for bar in bars)
    own = [(concept, bar) for concept, bar in zip(answer.concepts, bars, strict=True) if concept.time == answer.time]
    assert len(own) == len(known.concepts.concepts)
    assert [bar for _, bar in own] == sorted((bar for _, bar in own), reverse=True)
    assert own[0][1] == 1
    assert own[-1][1] == (0 if len(own) > 1 else 1)


def test_a_concept_keeps_its_colour_when_it_takes_smaller_ones_in(application: Application, model: ShapeModel) -> None:
    size, graph = model.stimuli.shape[0], application.models.annexations("tiny", 1)
    known = Learnt(application.models.concepts("tiny", 1, 1.0), graph)
    annexing = {size + place: edge[1] for place, edge in zip(graph.order, graph.edges, strict=True)}
    for one, other in itertools.combinations(annexing, 2):
        same = known.colours([one]) == known.colours([other])
        assert same == (annexing[one] == annexing[other])
    assert known.colours([max(annexing)]) == (colour(0),)


def test_many_numbers_have_colours_of_their_own() -> None:
    every = [colour(number) for number in range(64)]
    assert len({*every, ABSENT}) == len(every) + 1
    lights = [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in map(parts, scale())]
    assert lights == sorted(lights)
