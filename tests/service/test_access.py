"""The gate: scopes, rates and numbers at a time; and where it stands open."""

from __future__ import annotations

import math
import re
from contextlib import ExitStack
from pathlib import Path
from random import Random

import pytest

from service.access import NOBODY, Gate, check_keys, check_tls, needs_keys
from service.engine.errors import InvalidParameter, NotAllowed, NotAuthenticated, RateExceeded
from service.keys import KeyStore
from service.settings import Settings

SERVICE = Settings(max_body=10_000, max_points=5_000, max_batch=16)


class Clock:
    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def keys(tmp_path: Path) -> KeyStore:
    return KeyStore(tmp_path)


def test_an_open_gate_lets_everybody_in() -> None:
    for text in (None, "", "anything"):
        with Gate(None, SERVICE).entered(text, "manage") as caller:
            assert caller.id == NOBODY
            assert (caller.max_body, caller.max_points, caller.max_batch) == (10_000, 5_000, 16)


def test_a_key_opens_what_it_is_for_and_nothing_else(keys: KeyStore) -> None:
    text, key = keys.create("robot-7", ("answer", "train"))
    gate = Gate(keys.valid, SERVICE)
    for scope in ("answer", "train"):
        with gate.entered(text, scope) as caller:
            assert (caller.id, caller.name) == (key.id, "robot-7")
    with pytest.raises(NotAllowed, match="allows to answer, train, not to manage"), gate.entered(text, "manage"):
        pass
    for nothing in (None, "", "sc_wrong"):
        with pytest.raises(NotAuthenticated), gate.entered(nothing, "answer"):
            pass


def test_a_key_revoked_meanwhile_is_refused(keys: KeyStore) -> None:
    text, key = keys.create("robot-7", ("answer",))
    gate = Gate(keys.valid, SERVICE)
    with gate.entered(text, "answer"):
        keys.revoke(key.id)  # what is under way is finished
    with pytest.raises(NotAuthenticated), gate.entered(text, "answer"):
        pass


def test_no_more_requests_are_under_way_than_a_key_may_have(keys: KeyStore) -> None:
    text, _ = keys.create("robot-7", ("answer",), concurrency=2)
    other, _ = keys.create("robot-8", ("answer",), concurrency=1)
    gate = Gate(keys.valid, SERVICE)
    with ExitStack() as under_way:
        for _ in range(2):
            under_way.enter_context(gate.entered(text, "answer"))
        with pytest.raises(RateExceeded, match="2 requests under way"), gate.entered(text, "answer"):
            pass
        under_way.enter_context(gate.entered(other, "answer"))
    with gate.entered(text, "answer"):
        pass


def test_a_request_that_fails_gives_its_place_back(keys: KeyStore) -> None:
    text, _ = keys.create("robot-7", ("answer",), concurrency=1)
    gate = Gate(keys.valid, SERVICE)
    for _ in range(3):
        with pytest.raises(RuntimeError), gate.entered(text, "answer"):
            raise RuntimeError


@pytest.mark.parametrize(("rate", "at_once", "after"), [(5.0, 5, 0.2), (0.5, 1, 2.0), (1.0, 1, 1.0)])
def test_a_key_makes_so_many_requests_a_second(keys: KeyStore, rate: float, at_once: int, after: float) -> None:
    text, _ = keys.create("robot-7", ("answer",), rate=rate)
    clock = Clock()
    gate = Gate(keys.valid, SERVICE, clock)

    def passes() -> bool:
        try:
            with gate.entered(text, "answer"):
                return True
        except RateExceeded:
            return False

    assert [passes() for _ in range(at_once + 2)] == [True] * at_once + [False] * 2
    clock.time += after * 1.001
    assert [passes(), passes()] == [True, False]
    clock.time += 3600  # rest is not saved up
    assert sum(passes() for _ in range(50)) == at_once


def refusal(gate: Gate, text: str, clouds: int) -> RateExceeded | None:
    """Why a request with so many clouds does not get through; None if it does."""
    try:
        with gate.entered(text, "answer") as caller:
            caller.spend(clouds)
            return None
    except RateExceeded as error:
        return error


@pytest.mark.parametrize("clouds", [1, 2, 7, 10])
def test_a_request_with_several_clouds_counts_as_many_as_it_has(keys: KeyStore, clouds: int) -> None:
    text, _ = keys.create("robot-7", ("answer",), rate=10)
    gate = Gate(keys.valid, SERVICE, Clock())
    assert refusal(gate, text, clouds) is None
    assert sum(refusal(gate, text, 1) is None for _ in range(20)) == 10 - clouds


def test_of_a_stream_each_cloud_counts_and_one_too_many_ends_nothing(keys: KeyStore) -> None:
    text, _ = keys.create("robot-7", ("answer",), rate=3)
    clock = Clock()

    def taken() -> bool:
        try:
            caller.spend(1)
            return True
        except RateExceeded:
            return False

    with Gate(keys.valid, SERVICE, clock).entered(text, "answer") as caller:
        assert [taken() for _ in range(5)] == [True] * 3 + [False] * 2
        for _ in range(3):
            clock.time += 1.001 / 3
            assert [taken(), taken()] == [True, False]


@pytest.mark.parametrize("rate", [0.1, 0.7, 1.0, 3.3, 7.1, 50.0])
@pytest.mark.parametrize("clouds", [1, 2, 5, 64])
def test_whoever_comes_back_when_told_to_is_let_in(keys: KeyStore, rate: float, clouds: int) -> None:
    text, _ = keys.create("robot-7", ("answer",), rate=rate)
    clock = Clock()
    gate = Gate(keys.valid, SERVICE, clock)
    for _ in range(70):
        told = []
        while (error := refusal(gate, text, clouds)) and len(told) < 3:
            told.append(error)
            assert f"{rate:g} requests a second" in str(error)
            assert f"try again in {math.ceil(error.after)} s" in str(error)
            clock.time += error.after * 1.0001
        assert len(told) <= (1 if clouds == 1 else 2)  # at the door it is not known how many clouds will come
    assert clock.time > 1000  # it was refused now and then


@pytest.mark.parametrize("rate", [0.5, 3.0, 10.0])
def test_in_the_long_run_a_key_has_its_rate_answered_and_no_more(keys: KeyStore, rate: float) -> None:
    """Whatever the sizes of its batches: larger ones than a second's worth are paid off before the next request."""
    text, _ = keys.create("robot-7", ("answer",), rate=rate)
    clock, random = Clock(), Random(7)
    gate = Gate(keys.valid, SERVICE, clock)
    began, answered, largest = clock.time, 0, 0
    for _ in range(3000):
        clouds = random.choice([1, 1, 1, 2, 3, 12, 40])
        if refusal(gate, text, clouds) is None:
            answered, largest = answered + clouds, max(largest, clouds)
        assert answered <= rate * (clock.time - began) + max(rate, 1) + largest
        clock.time += random.expovariate(rate / 2)
    assert largest == 40
    assert answered > 0.5 * rate * (clock.time - began)


def test_who_has_no_rate_is_not_counted(keys: KeyStore) -> None:
    text, _ = keys.create("robot-7", ("answer",))
    for gate in (Gate(keys.valid, SERVICE), Gate(None, SERVICE)):
        with gate.entered(text, "answer") as caller:
            for _ in range(3):
                caller.spend(10**6)


@pytest.mark.parametrize(
    ("own", "hold"),
    [
        ({}, (10_000, 5_000, 16)),
        ({"max_body": 2_000}, (2_000, 5_000, 16)),
        ({"max_points": 100, "max_batch": 1}, (10_000, 100, 1)),
        ({"max_body": 10**12, "max_points": 10**12, "max_batch": 10**12}, (10_000, 5_000, 16)),
    ],
)
def test_of_the_limits_of_a_key_and_of_the_service_the_smaller_ones_hold(
    keys: KeyStore, own: dict[str, int], hold: tuple[int, int, int]
) -> None:
    text, _ = keys.create("robot-7", ("answer",), **own)
    with Gate(keys.valid, SERVICE).entered(text, "answer") as caller:
        assert (caller.max_body, caller.max_points, caller.max_batch) == hold


@pytest.mark.parametrize(
    ("host", "access", "needed"),
    [
        ("127.0.0.1", "auto", False),
        ("127.8.0.1", "auto", False),
        ("localhost", "auto", False),
        ("::1", "auto", False),
        ("0.0.0.0", "auto", True),
        ("::", "auto", True),
        ("192.168.1.4", "auto", True),
        ("robot.local", "auto", True),
        ("127.0.0.1", "keys", True),
        ("0.0.0.0", "open", False),
    ],
)
def test_keys_are_needed_wherever_others_reach_unless_told_otherwise(
    host: str, access: str, needed: bool, keys: KeyStore, tmp_path: Path
) -> None:
    settings = Settings(store=str(tmp_path), host=host, access=access)
    assert needs_keys(settings) is needed
    if needed:
        with pytest.raises(InvalidParameter, match="shape-concepts keys create"):
            check_keys(settings, keys.valid())
    keys.create("robot-7", ("answer",))
    check_keys(settings, keys.valid())


@pytest.mark.parametrize(
    ("endpoint", "needed"),
    [
        ("tcp/127.0.0.1:7447", False),
        ("tcp/localhost:0", False),
        ("tls/[::1]:7447?rel=0#iface=lo", False),
        ("unixsock-stream//run/zenoh", False),
        ("tcp/0.0.0.0:7447", True),
        ("tls/[::]:7447", True),
        ("udp/robot.local:7447", True),
    ],
)
def test_keys_are_needed_where_others_reach_the_service_over_zenoh(
    endpoint: str, needed: bool, keys: KeyStore, tmp_path: Path
) -> None:
    settings = Settings(store=str(tmp_path), zenoh_listen=("tcp/127.0.0.1:1", endpoint))
    assert needs_keys(settings) is needed
    if needed:
        with pytest.raises(InvalidParameter, match=f"can reach {re.escape(endpoint)}"):
            check_keys(settings, keys.valid())


def test_half_a_configuration_of_tls_is_told(tmp_path: Path) -> None:
    file = tmp_path / "service.pem"
    file.write_text("")
    check_tls(Settings())
    check_tls(Settings(tls_certificate=file, tls_key=file))
    with pytest.raises(InvalidParameter, match="SHAPE_CONCEPTS_TLS_KEY"):
        check_tls(Settings(tls_certificate=file))
    with pytest.raises(InvalidParameter, match="no file"):
        check_tls(Settings(tls_certificate=file, tls_key=tmp_path / "lost.key"))
