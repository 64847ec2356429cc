"""Rendezvous hashing: all agree, and when one dies only its items move."""

from __future__ import annotations

from collections import Counter

from service.transports.zenoh.replicas import owner

ITEMS = [f"robots/{number}/cloud".encode() for number in range(3000)]
REPLICAS = frozenset(f"{number:032x}" for number in range(4))


def test_items_are_spread_evenly() -> None:
    counts = Counter(owner(REPLICAS, item) for item in ITEMS)
    assert set(counts) == REPLICAS
    assert max(counts.values()) < 1.2 * len(ITEMS) / len(REPLICAS)


def test_only_the_items_of_the_dead_move() -> None:
    for dead in REPLICAS:
        left = REPLICAS - {dead}
        for item in ITEMS[:500]:
            before = owner(REPLICAS, item)
            assert owner(left, item) == before or before == dead


def test_one_replica_answers_all() -> None:
    assert {owner(frozenset({"only"}), item) for item in ITEMS} == {"only"}
