"""Names proposed from labels: the majority of each concept's clouds, and nothing where labels tie."""

from __future__ import annotations

from service.proposals import propose


def test_the_label_of_most_clouds_is_proposed_with_its_share_and_support() -> None:
    best = [(7, "mug"), (9, "bowl"), (7, "mug"), (7, "bowl"), (9, "bowl")]
    mug, bowl = propose(best, {9: "plate"})
    assert (mug.concept, mug.name, mug.current, mug.support, mug.share) == (7, "mug", None, 3, 2 / 3)
    assert mug.labels == {"mug": 2, "bowl": 1}
    assert (bowl.concept, bowl.name, bowl.current, bowl.support, bowl.share) == (9, "bowl", "plate", 2, 1)
    assert mug.tied == bowl.tied == []


def test_labels_that_tie_are_told_and_none_is_proposed() -> None:
    (proposal,) = propose([(7, "mug"), (7, "can"), (7, "bowl"), (7, "can"), (7, "mug")], {})
    assert (proposal.name, proposal.tied, proposal.share) == (None, ["can", "mug"], 2 / 5)


def test_the_order_of_the_clouds_does_not_matter() -> None:
    best = [(7, "mug"), (9, "bowl"), (7, "can"), (8, "can")]
    assert propose(best, {}) == propose(best[::-1], {})
    assert propose([], {}) == []
