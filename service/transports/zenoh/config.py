"""From the service's settings to a configuration of zenoh."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zenoh

from service.access import others_reach
from service.engine.errors import InvalidParameter
from service.settings import Settings

LISTEN = "listen/endpoints"
TLS = "transport/link/tls/"
USER = "transport/auth/usrpwd/"
DROPPING = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"
HASTY = 1000  # microseconds, what zenoh waits by default for room on a connection before it drops a message
PATIENT = 100_000  # microseconds: a busy machine may not run the sender for longer than that default


def is_wanted(settings: Settings) -> bool:
    """Whether the service takes part in zenoh: it does once it is told whom to connect to, or where to listen.

    Raises:
        InvalidParameter: other settings of zenoh are there, which would have no effect.
    """
    if settings.zenoh_connect or settings.zenoh_listen or settings.zenoh_config:
        return True
    if settings.streams or settings.zenoh_mode:
        raise InvalidParameter(
            "Streams or a zenoh mode are set, but zenoh is off: say whom to connect to "
            "(SHAPE_CONCEPTS_ZENOH_CONNECT=tcp/HOST:7447), where to listen (SHAPE_CONCEPTS_ZENOH_LISTEN) or a "
            "configuration file (SHAPE_CONCEPTS_ZENOH_CONFIG)."
        )
    return False


def configuration(settings: Settings) -> zenoh.Config:
    """A configuration of zenoh: the file, if there is one, and over it what the settings say.

    Nodes are not searched for by multicast unless the file says so.

    Raises:
        InvalidParameter: the file or one of the settings cannot be used.
    """
    config = _from_file(settings.zenoh_config)
    for path, value in _wanted(settings, config):
        try:
            config.insert_json5(path, json.dumps(value))
        except zenoh.ZError as error:
            raise InvalidParameter(f"zenoh does not take {value!r} for {path}: {_first(error)}") from None
    return config


def mode_of(config: zenoh.Config) -> str:
    """What a node with this configuration is: client, peer or router."""
    return json.loads(config.get_json("mode")) or "peer"


def endpoints_of(config: zenoh.Config) -> list[str]:
    """Where a node with this configuration listens."""
    told = json.loads(config.get_json(LISTEN)) or []
    return list(told.get(mode_of(config)) or []) if isinstance(told, dict) else list(told)


def check_endpoints(config: zenoh.Config) -> None:
    """Refuses to let everybody in from elsewhere.

    Raises:
        InvalidParameter: others can reach an endpoint that is listened on.
    """
    for endpoint in endpoints_of(config):
        if others_reach(endpoint):
            raise InvalidParameter(
                f"zenoh would listen on {endpoint}, which others can reach, and nobody needs an access key: ask for "
                "keys with SHAPE_CONCEPTS_ACCESS=keys, or let everybody in with SHAPE_CONCEPTS_ACCESS=open."
            )


def _from_file(path: Path | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    try:
        return zenoh.Config.from_file(_readable(path, "configuration of zenoh"))
    except zenoh.ZError as error:
        raise InvalidParameter(f"The configuration of zenoh {path} cannot be used: {_first(error)}") from None


def _wanted(settings: Settings, config: zenoh.Config) -> Iterator[tuple[str, Any]]:
    """Paths in zenoh's configuration and their values."""
    own_endpoints = config.get_json(LISTEN) != zenoh.Config().get_json(LISTEN)  # the file's
    if json.loads(config.get_json("scouting/multicast/enabled")) is None:
        yield "scouting/multicast/enabled", False
    # zenoh loses queries under a stalled receiver when they go through shared memory (eclipse-zenoh/zenoh#2628).
    yield "transport/shared_memory/transport_optimization/messages", ["put"]
    if json.loads(config.get_json(DROPPING)) == HASTY:
        yield DROPPING, PATIENT
    if settings.zenoh_mode or json.loads(config.get_json("mode")) is None:
        # Two peers that do not listen cannot hear each other through a router; two clients can.
        yield "mode", settings.zenoh_mode or ("peer" if settings.zenoh_listen or own_endpoints else "client")
    if settings.zenoh_connect:
        yield "connect/endpoints", settings.zenoh_connect
    if settings.zenoh_listen or not own_endpoints:  # by default, zenoh would let everybody in
        yield LISTEN, settings.zenoh_listen
    if settings.zenoh_user is not None:
        if settings.zenoh_password is None:
            raise InvalidParameter("SHAPE_CONCEPTS_ZENOH_USER needs SHAPE_CONCEPTS_ZENOH_PASSWORD.")
        yield USER + "user", settings.zenoh_user
        yield USER + "password", settings.zenoh_password.get_secret_value()
    if settings.zenoh_ca:
        yield TLS + "root_ca_certificate", _readable(settings.zenoh_ca, "certificates of authorities")
    if settings.zenoh_certificate or settings.zenoh_key:
        if not (settings.zenoh_certificate and settings.zenoh_key):
            raise InvalidParameter("SHAPE_CONCEPTS_ZENOH_CERTIFICATE and SHAPE_CONCEPTS_ZENOH_KEY need each other.")
        for side in ("connect", "listen"):
            yield f"{TLS}{side}_certificate", _readable(settings.zenoh_certificate, "certificate")
            yield f"{TLS}{side}_private_key", _readable(settings.zenoh_key, "private key")
        yield TLS + "enable_mtls", settings.zenoh_ca is not None


def _readable(path: Path, what: str) -> str:
    try:
        with path.open("rb"):
            return str(path)
    except OSError as error:
        raise InvalidParameter(f"The {what} {path} cannot be read: {error.strerror}.") from None


def _first(error: zenoh.ZError) -> str:
    """What zenoh says, without the places in its source."""
    return str(error).partition(" at /")[0].strip()[:300]
