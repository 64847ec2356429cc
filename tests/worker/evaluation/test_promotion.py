"""The rule of promotion: not worse in any figure, by more than is tolerated."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from worker.evaluation.promotion import Rule, decide

OLD = {"knn": 0.9, "svm": 0.8, "within": 0.7, "assigned": 0.6, "answered": 1.0}
figure = st.floats(0, 1)
metrics = st.fixed_dictionaries(dict.fromkeys(OLD, figure))


def test_what_is_equal_or_better_is_promoted() -> None:
    assert decide(OLD, OLD, Rule(tolerance=0)).promote
    assert decide(OLD, {**OLD, "svm": 0.95}, Rule(tolerance=0)).promote


@pytest.mark.parametrize("name", OLD)
def test_one_figure_that_is_worse_decides_however_good_the_others_are(name: str) -> None:
    better = {other: min(1.0, value + 0.2) for other, value in OLD.items()}
    verdict = decide(OLD, {**better, name: OLD[name] - 0.03}, Rule())
    assert not verdict.promote
    (reason,) = [reason for reason in verdict.reasons if "more than the tolerated 0.02" in reason]
    assert reason.startswith(f"{name} {OLD[name] - 0.03:.3f}, before {OLD[name]:.3f}")


def test_what_is_tolerated_is_told_and_is_no_loss_of_digits() -> None:
    verdict = decide(OLD, {**OLD, "knn": 0.88}, Rule(tolerance=0.02))
    assert verdict.promote
    assert "knn 0.880, before 0.900: worse by 0.020, which is tolerated (up to 0.02)" in verdict.reasons
    assert not decide(OLD, {**OLD, "knn": 0.88}, Rule(tolerance=0.019)).promote


def test_a_figure_that_is_not_known_or_no_number_is_worse() -> None:
    assert not decide(OLD, {name: value for name, value in OLD.items() if name != "within"}, Rule()).promote
    assert not decide(OLD, {**OLD, "within": float("nan")}, Rule(tolerance=1)).promote


def test_where_there_was_nothing_the_first_version_is_promoted() -> None:
    assert decide(None, {}, Rule()).promote


@given(metrics, metrics, st.floats(0, 1), st.floats(0, 1))
def test_a_more_tolerant_rule_refuses_nothing_that_a_stricter_one_lets_pass(
    old: dict[str, float], new: dict[str, float], one: float, other: float
) -> None:
    strict, tolerant = (decide(old, new, Rule(tolerance=share)) for share in sorted((one, other)))
    assert tolerant.promote or not strict.promote
    assert len(strict.reasons) == len(OLD)
    assert strict.promote == all("more than" not in reason for reason in strict.reasons)
