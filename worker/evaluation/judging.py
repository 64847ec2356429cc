"""The figures of the quality protocol alone, of one model or of two by the same clouds: what promotion goes by."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from service.engine.errors import InvalidParameter
from worker.evaluation import protocols
from worker.evaluation.answering import Answered, AnsweredSet
from worker.evaluation.judgement import judge, mean_figures
from worker.evaluation.labels import judged
from worker.evaluation.protocols import Samples
from worker.evaluation.report import Figures

ANSWERED = "answered"  # the share of the clouds that a model did not refuse


def figures_of(answered: AnsweredSet, among: Iterable[str] | None = None) -> dict[str, float]:
    """The four figures of a model, means over labels, and the share of the clouds that it answered.

    All four are 0 of a model that answers all clouds alike, so that nothing can be told from its responses.

    Args:
        answered: labelled clouds and what the model said.
        among: files of the clouds that the figures are made of; None for all that were answered.

    Raises:
        InvalidParameter: the clouds are too few to judge by.
    """
    chosen = None if among is None else set(among)
    clouds = [each for each in answered.answered if chosen is None or each.cloud.file in chosen]
    kept = [clouds[place] for place in judged([each.cloud for each in clouds])]
    samples = _samples(kept)
    asked = len(answered.answered) + len(answered.refused)
    figures = dict.fromkeys(Figures.model_fields, 0.0)
    if protocols.tells_apart(samples):
        protocols.require(samples)
        figures = mean_figures(judge(samples).by_label()).model_dump()
    return {**figures, ANSWERED: len(answered.answered) / asked}


def figures_of_both(old: AnsweredSet, new: AnsweredSet) -> tuple[dict[str, float], dict[str, float]]:
    """The figures of two models, by the clouds that both answered: a cloud that one refuses is in neither's figures.

    Raises:
        InvalidParameter: these clouds are too few to judge by.
    """
    both = {each.cloud.file for each in old.answered} & {each.cloud.file for each in new.answered}
    if not both:
        raise InvalidParameter("There is no labelled cloud that both versions answer.")
    return figures_of(old, both), figures_of(new, both)


def _samples(clouds: Sequence[Answered]) -> Samples:
    return Samples(
        np.stack([each.responses for each in clouds]),
        np.array([each.cloud.category for each in clouds]),
        np.array([each.cloud.group for each in clouds]),
    )
