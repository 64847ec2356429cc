"""Who may do what: the one place that every transport asks before it works for a client."""

from __future__ import annotations

import ipaddress
import math
import re
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from service.engine.errors import InvalidParameter, NotAllowed, NotAuthenticated, RateExceeded
from service.keys import AccessKey, authenticate
from service.scopes import Scope
from service.settings import Settings
from service.telemetry import current

NOBODY = "anonymous"


class Caller(NamedTuple):
    """Who is asking, and what one request of theirs may hold: the smaller of the service's limits and the key's.

    Attributes:
        id: of the access key.
        name: of the access key: whose it is.
        max_body: largest body, message or payload, bytes.
        max_points: largest cloud, points.
        max_batch: largest batch, clouds.
        spend: counts clouds of the request against the key's rate, all or none; the first one was counted as the
            request entered. Raises `RateExceeded`.
    """

    id: str
    name: str
    max_body: int
    max_points: int
    max_batch: int
    spend: Callable[[int], None] = lambda clouds: None


class Gate:
    """Lets callers in by their access keys, as often and as many at a time as the keys allow.

    Args:
        valid: gives the keys that are not revoked, by id; None lets everybody in.
        settings: the limits of the service, above which no key has its own.
        now: a clock, seconds.
        at_hand: whether `valid` would answer at once just now.
    """

    def __init__(
        self,
        valid: Callable[[], Mapping[str, AccessKey]] | None,
        settings: Settings,
        now: Callable[[], float] = clock.monotonic,
        at_hand: Callable[[], bool] = lambda: False,
    ) -> None:
        self.anybody = Caller(NOBODY, NOBODY, settings.max_body, settings.max_points, settings.max_batch)
        self._valid = valid
        self._now = now
        self._at_hand = at_hand
        self._spent: dict[str, _Spent] = {}
        self._lock = threading.Lock()

    @property
    def open(self) -> bool:
        """Whether no key is needed."""
        return self._valid is None

    @property
    def at_hand(self) -> bool:
        """Whether callers can be let in at once: no key is needed, or the keys need not be read now."""
        return self._valid is None or self._at_hand()

    @contextmanager
    def entered(self, text: str | None, *scopes: Scope) -> Iterator[Caller]:
        """The caller, for as long as the request is under way.

        Args:
            text: the access key as the client sent it, None for none.
            scopes: what the request does; a key that allows one of them allows it.

        Raises:
            NotAuthenticated: there is no key, or it is unknown or revoked.
            NotAllowed: the key does not allow this.
            RateExceeded: the key's requests are too many, a second or at a time. Its clouds may be as well: then the
                caller's `spend` raises this.
        """
        if self._valid is None:
            yield self.anybody
            return
        key = self._known(text, scopes)
        if (seen := current()) is not None:
            seen.caller = key.id
        self._enter(key)
        try:
            yield self._caller(key)
        finally:
            with self._lock:
                self._spent[key.id].under_way -= 1

    def _known(self, text: str | None, scopes: tuple[Scope, ...]) -> AccessKey:
        if not text:
            raise NotAuthenticated("An access key is needed; ask the operator of the service for one.")
        assert self._valid is not None
        key = authenticate(text, self._valid())
        if not set(scopes) & set(key.scopes):
            asked = " or ".join(scopes)
            raise NotAllowed(f"The access key '{key.name}' allows to {', '.join(key.scopes)}, not to {asked}.")
        return key

    def _caller(self, key: AccessKey) -> Caller:
        """Who holds a key, for one request."""
        own = self.anybody
        paid = 1

        def spend(clouds: int) -> None:
            nonlocal paid
            with self._lock:
                self._take(key, clouds, min(clouds, paid))
                paid -= min(clouds, paid)

        return Caller(
            key.id,
            key.name,
            _smaller(own.max_body, key.max_body),
            _smaller(own.max_points, key.max_points),
            _smaller(own.max_batch, key.max_batch),
            spend,
        )

    def _enter(self, key: AccessKey) -> None:
        """Takes one of the requests that the key has left."""
        with self._lock:
            spent = self._spent.setdefault(key.id, _Spent(key.rate, self._now()))
            if key.concurrency is not None and spent.under_way >= key.concurrency:
                raise RateExceeded(
                    f"The access key '{key.name}' has {key.concurrency} requests under way, as many as it may; try "
                    "again when one is answered."
                )
            self._take(key, 1)
            spent.under_way += 1

    def _take(self, key: AccessKey, clouds: int, paid: int = 0) -> None:
        """Takes what so many clouds cost, less what is paid for; the lock is held."""
        if key.rate is None or clouds <= paid:
            return
        wait = self._spent[key.id].take(clouds, paid, key.rate, self._now())
        if wait > 0:
            advice = "try again" if clouds == 1 else "send fewer clouds at a time, or try again"
            raise RateExceeded(
                f"The access key '{key.name}' may make {key.rate:g} requests a second, and each cloud counts as one; "
                f"{advice} in {math.ceil(wait)} s.",
                wait,
            )


def _smaller(service: int, key: int | None) -> int:
    return service if key is None else min(service, key)


class _Spent:
    """What a key has left: a bucket of tokens, one for each request or cloud, full after a second of rest."""

    def __init__(self, rate: float | None, now: float) -> None:
        self.under_way = 0
        self._tokens = max(rate or 0, 1.0)
        self._at = now

    def take(self, clouds: int, paid: int, rate: float, now: float) -> float:
        """Takes the tokens of clouds, less those that are paid for; returns how long to wait, seconds, if it cannot.

        More clouds than the bucket can hold are taken when it is full, on credit: nothing else is until that is paid
        off, so that in the long run there are never more than the rate.
        """
        full = max(rate, 1.0)
        self._tokens = min(self._tokens + (now - self._at) * rate, full)
        self._at = now
        needed = min(clouds, full)
        if self._tokens < needed - paid:
            return (needed - self._tokens) / rate
        self._tokens -= clouds - paid
        return 0.0


def needs_keys(settings: Settings) -> bool:
    """Whether callers need access keys: elsewhere than on the loopback address, unless told otherwise."""
    return settings.access == "keys" or (settings.access == "auto" and _reachable(settings) is not None)


def _reachable(settings: Settings) -> str | None:
    """An address listened on that other machines reach, of HTTP or zenoh; None if there is none."""
    zenoh = [endpoint for endpoint in settings.zenoh_listen if others_reach(endpoint)]
    return next(iter([settings.host] * (not is_loopback(settings.host)) + zenoh), None)


def others_reach(endpoint: str) -> bool:
    """Whether other machines can reach an endpoint of zenoh."""
    return not is_loopback(_host_of(endpoint))


def _host_of(endpoint: str) -> str:
    """The host of an endpoint of zenoh, PROTOCOL/HOST:PORT?METADATA#CONFIGURATION."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unix"):  # files of this machine
        return "localhost"
    return re.split("[?#]", address)[0].rpartition(":")[0]


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def check_tls(settings: Settings) -> None:
    """Refuses half a configuration of TLS, and files that are not there.

    Raises:
        InvalidParameter: the message says what is missing.
    """
    if (settings.tls_certificate is None) != (settings.tls_key is None):
        raise InvalidParameter(
            "TLS needs a certificate and its key: set SHAPE_CONCEPTS_TLS_CERTIFICATE and SHAPE_CONCEPTS_TLS_KEY."
        )
    for file in (settings.tls_certificate, settings.tls_key):
        if file is not None and not file.is_file():
            raise InvalidParameter(f"There is no file {file} for TLS.")


def check_keys(settings: Settings, valid: Mapping[str, AccessKey]) -> None:
    """Refuses to listen where keys are needed and there are none.

    Raises:
        InvalidParameter: there is none; the message says how to make one, or how to do without.
    """
    if needs_keys(settings) and not valid:
        raise InvalidParameter(
            f"Others can reach {reachable}, and there is no access key yet: make one with shape-concepts keys "
            "create NAME --scope answer, or let everybody in with SHAPE_CONCEPTS_ACCESS=open."
            if (reachable := _reachable(settings))
            else "Access keys are asked for, and there is none yet: make one with shape-concepts keys create NAME "
            "--scope answer."
        )
