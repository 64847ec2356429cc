"""Who may do what: the one place that every transport asks before it works for a client."""

from __future__ import annotations

import ipaddress
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
    """Who is asking: the id and the name of the access key, for logs."""

    id: str
    name: str


ANYBODY = Caller(NOBODY, NOBODY)


class Gate:
    """Lets callers in by their access keys, as often and as many at a time as the keys allow.

    Args:
        valid: gives the keys that are not revoked, by id; None lets everybody in.
        now: a clock, seconds.
    """

    def __init__(
        self, valid: Callable[[], Mapping[str, AccessKey]] | None, now: Callable[[], float] = clock.monotonic
    ) -> None:
        self._valid = valid
        self._now = now
        self._spent: dict[str, _Spent] = {}
        self._lock = threading.Lock()

    @property
    def open(self) -> bool:
        """Whether no key is needed."""
        return self._valid is None

    @contextmanager
    def entered(self, text: str | None, *scopes: Scope) -> Iterator[Caller]:
        """The caller, for as long as the request is under way.

        Args:
            text: the access key as the client sent it, None for none.
            scopes: what the request does; a key that allows one of them allows it.

        Raises:
            NotAuthenticated: there is no key, or it is unknown or revoked.
            NotAllowed: the key does not allow this.
            RateExceeded: the key's requests are too many, a second or at a time.
        """
        if self._valid is None:
            yield ANYBODY
            return
        key = self._known(text, scopes)
        if (seen := current()) is not None:
            seen.caller = key.id
        self._enter(key)
        try:
            yield Caller(key.id, key.name)
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

    def _enter(self, key: AccessKey) -> None:
        """Takes one of the requests that the key has left: a bucket of tokens, full after a second of rest."""
        with self._lock:
            spent = self._spent.setdefault(key.id, _Spent(key.rate, self._now()))
            if key.concurrency is not None and spent.under_way >= key.concurrency:
                raise RateExceeded(
                    f"The access key '{key.name}' has {key.concurrency} requests under way, as many as it may; try "
                    "again when one is answered."
                )
            if key.rate is not None and not spent.take(key.rate, self._now()):
                raise RateExceeded(
                    f"The access key '{key.name}' may make {key.rate:g} requests a second; try again in "
                    f"{max(1.0, 1 / key.rate):.0f} s."
                )
            spent.under_way += 1


class _Spent:
    """What a key has left."""

    def __init__(self, rate: float | None, now: float) -> None:
        self.under_way = 0
        self._tokens = max(rate or 0, 1.0)
        self._at = now

    def take(self, rate: float, now: float) -> bool:
        self._tokens = min(self._tokens + (now - self._at) * rate, max(rate, 1.0))
        self._at = now
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True


def needs_keys(settings: Settings) -> bool:
    """Whether callers need access keys: elsewhere than on the loopback address, unless told otherwise."""
    return settings.access == "keys" or (settings.access == "auto" and _reachable(settings) is not None)


def _reachable(settings: Settings) -> str | None:
    """An address listened on that other machines reach, of HTTP or zenoh; None if there is none."""
    zenoh = [endpoint for endpoint in settings.zenoh_listen if not is_loopback(_host_of(endpoint))]
    return next(iter([settings.host] * (not is_loopback(settings.host)) + zenoh), None)


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
