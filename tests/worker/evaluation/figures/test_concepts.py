"""Concepts as cards, and as ranked columns."""

from __future__ import annotations

import base64
import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from tests.worker.evaluation.figures.reports import LABELS, colours_in, grouping, structure, thumbnails
from worker.evaluation.figures.concepts import CARDS, SHOWN, concept_figure, ranked_figure
from worker.evaluation.figures.figure import Figure
from worker.evaluation.figures.palette import Palette

PALETTE = Palette(LABELS)


def cards_of(size: int, labels: tuple[str | None, ...] = LABELS) -> Figure:
    embedded = np.random.default_rng(1).random((size, 3))
    return concept_figure(structure(size, labels), thumbnails(size), embedded, PALETTE)


def test_every_prototype_of_a_concept_is_shown_or_counted() -> None:
    of, figure = structure(200), cards_of(200)
    sizes = np.bincount([place for place in of.assignment if place >= 0])
    assert len(figure.cards) == min(CARDS, len(of.concepts))
    for size, card in zip(sizes, figure.cards, strict=False):
        assert len(card.thumbnails) == min(size, SHOWN)
        assert len(card.thumbnails) + card.left_out == size
    assert f"{(np.array(of.assignment) < 0).sum()} of 200 objects stand alone" in figure.caption


def test_concepts_beyond_what_can_be_looked_at_are_counted() -> None:
    of, figure = structure(900), cards_of(900)
    assert len(of.concepts) > CARDS
    assert f"The {len(of.concepts) - CARDS} smallest of {len(of.concepts)} concepts" in figure.left_out


def test_a_thumbnail_is_the_model_s_own_on_a_transparent_ground() -> None:
    of, figure = structure(60), cards_of(60)
    images = {tuple(each.ravel()) for each in thumbnails(60)}
    for shown in figure.cards[0].thumbnails:
        png = Image.open(BytesIO(base64.b64decode(shown.image.removeprefix("data:image/png;base64,"))))
        shade, opacity = (np.asarray(channel) for channel in png.split())
        assert tuple(shade.ravel()) in images
        np.testing.assert_array_equal(opacity > 0, shade > 0)
    keys = {shown.alt.split(", ")[1] for shown in figure.cards[0].thumbnails}
    assert keys <= {key for key, place in zip(of.keys, of.assignment, strict=True) if place == 0}


def test_the_most_typical_prototypes_come_first() -> None:
    of = structure(200)
    members = np.flatnonzero(np.array(of.assignment) == 0)
    embedded = np.zeros((200, 1))
    embedded[members, 0] = np.arange(len(members)) - len(members) / 2
    first = concept_figure(of, thumbnails(200), embedded, PALETTE).cards[0].thumbnails[0].alt
    assert any(of.keys[member] in first for member in members[np.abs(embedded[members, 0]) <= 1])


def test_columns_stand_in_the_order_of_the_rank_score() -> None:
    of = grouping(structure(60))
    figure = ranked_figure(structure(60), of, PALETTE)
    assert figure is not None
    numbers = re.findall(r">(\d+)</text>", figure.panels[0].picture)
    ascending = [str(concept.prototypes) for concept in reversed(of.concepts)]
    assert numbers[: len(ascending)] == ascending or numbers[-len(ascending) :] == ascending
    assert colours_in(figure.panels[0].picture) >= {PALETTE.mark(label).colour for label in LABELS}
    assert f"{of.pure:.0%} of the concepts are of one colour" in figure.caption


def test_without_labels_concepts_are_ranked_by_size() -> None:
    figure = ranked_figure(structure(60, (None,)), None, PALETTE)
    assert figure is not None
    assert "how large" in figure.title
    assert ranked_figure(None, None, PALETTE) is None


@pytest.mark.parametrize("size", [2, 3])
def test_the_smallest_models_have_cards(size: int) -> None:
    assert sum(len(card.thumbnails) for card in cards_of(size).cards) <= size
