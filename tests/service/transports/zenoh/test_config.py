"""Settings become a configuration of zenoh; strangers stay outside."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
import zenoh

from service.application import Application
from service.engine.errors import InvalidParameter
from service.settings import Settings
from service.transports.zenoh.config import configuration, endpoints_of, is_wanted, mode_of
from service.transports.zenoh.server import serving
from tests.service.transports.zenoh.certificates import Authority
from tests.service.transports.zenoh.conftest import replicas, running
from tests.service.transports.zenoh.router import free_endpoint, routing, session
from tests.service.transports.zenoh.waiting import until

HERE = "tcp/127.0.0.1:7447"


def changed(settings: Settings, **more: Any) -> Settings:
    return Settings(**settings.model_dump() | more)


def told(config: zenoh.Config, path: str) -> Any:
    return json.loads(config.get_json(path))


def test_zenoh_is_off_until_it_is_told_where(settings: Settings) -> None:
    assert not is_wanted(settings)
    for more in ({"zenoh_connect": [HERE]}, {"zenoh_listen": HERE}, {"zenoh_config": "zenoh.json5"}):
        assert is_wanted(changed(settings, **more))
    for more in ({"streams": [{"key": "a"}]}, {"zenoh_mode": "peer"}):
        with pytest.raises(InvalidParameter, match="ZENOH_CONNECT"):
            is_wanted(changed(settings, **more))


def test_who_listens_is_a_peer_and_who_does_not_a_client_unless_said_otherwise(settings: Settings) -> None:
    assert mode_of(configuration(changed(settings, zenoh_connect=HERE))) == "client"
    assert mode_of(configuration(changed(settings, zenoh_connect=HERE, zenoh_listen=HERE))) == "peer"
    for mode in ("client", "peer", "router"):
        assert mode_of(configuration(changed(settings, zenoh_listen=HERE, zenoh_mode=mode))) == mode


def test_nothing_is_searched_for_by_multicast_and_queries_shun_shared_memory(settings: Settings) -> None:
    config = configuration(changed(settings, zenoh_connect=HERE))
    assert told(config, "scouting/multicast/enabled") is False
    assert told(config, "transport/shared_memory/transport_optimization/messages") == ["put"]
    assert told(config, "listen/endpoints") == []


def test_a_busy_machine_has_time_to_send_unless_the_file_says_otherwise(settings: Settings, tmp_path: Path) -> None:
    path = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"
    assert told(configuration(changed(settings, zenoh_connect=HERE)), path) == 100_000
    file = tmp_path / "zenoh.json5"
    file.write_text("{transport: {link: {tx: {queue: {congestion_control: {drop: {wait_before_drop: 50}}}}}}}")
    assert told(configuration(changed(settings, zenoh_config=file)), path) == 50


def test_the_settings_go_before_the_file_and_the_file_before_defaults(settings: Settings, tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        '{mode: "peer", scouting: {multicast: {enabled: true}}, connect: {endpoints: ["tcp/h:1"]}, '
        'listen: {endpoints: ["tcp/127.0.0.1:2"]}, transport: {link: {tx: {lease: 3000}}}}'
    )
    config = configuration(changed(settings, zenoh_config=file))
    assert mode_of(config) == "peer"
    assert told(config, "scouting/multicast/enabled") is True
    assert told(config, "connect/endpoints") == ["tcp/h:1"]
    assert told(config, "listen/endpoints") == ["tcp/127.0.0.1:2"]
    assert told(config, "transport/link/tx/lease") == 3000
    config = configuration(changed(settings, zenoh_config=file, zenoh_connect=HERE, zenoh_mode="client"))
    assert (mode_of(config), told(config, "connect/endpoints")) == ("client", [HERE])


@pytest.mark.parametrize(
    ("text", "listens"),
    [
        ("{}", []),
        ('{mode: "peer"}', []),  # zenoh itself would open a port to everybody
        ('{mode: "router"}', []),
        ('{listen: {endpoints: ["tcp/127.0.0.1:7"]}}', ["tcp/127.0.0.1:7"]),
        ('{mode: "router", listen: {endpoints: {router: ["tcp/0.0.0.0:7"]}}}', ["tcp/0.0.0.0:7"]),
    ],
)
def test_a_file_listens_where_it_says_and_nowhere_else(
    settings: Settings, tmp_path: Path, text: str, listens: list[str]
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    config = configuration(changed(settings, zenoh_config=file))
    assert endpoints_of(config) == listens
    if listens:
        assert mode_of(config) != "client"


def test_a_file_that_listens_for_others_is_refused_without_keys(settings: Settings, tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text('{mode: "router", listen: {endpoints: {router: ["tcp/0.0.0.0:0"]}}}')
    application = Application(changed(settings, zenoh_config=file))

    async def serve() -> None:
        async with serving(application):
            pass

    with pytest.raises(InvalidParameter, match="SHAPE_CONCEPTS_ACCESS=keys"):
        asyncio.run(serve())
    application.close()


@pytest.mark.parametrize(
    "more",
    [
        {"zenoh_connect": "nonsense"},
        {"zenoh_config": "nowhere.json5"},
        {"zenoh_connect": HERE, "zenoh_user": "me"},
        {"zenoh_connect": HERE, "zenoh_key": __file__},
        {"zenoh_connect": HERE, "zenoh_ca": "nowhere.pem"},
        {"zenoh_config": __file__},
    ],
)
def test_what_zenoh_does_not_take_is_told(settings: Settings, more: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameter) as caught:
        configuration(changed(settings, **more))
    told = str(caught.value).replace(__file__, "")
    assert "/root/" not in told  # where zenoh was built
    assert ".rs:" not in told


def seen(connect: str, **more: Any) -> list[str]:
    """The replicas that somebody who connects sees; none when he is not let in."""
    try:
        robot = session(connect=connect, **{"connect/timeout_ms": 1500} | more)
    except zenoh.ZError:
        return []
    with robot:
        return replicas(robot)


def test_over_tls_both_sides_show_certificates_and_a_stranger_is_not_let_in(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "ours").mkdir()
    (tmp_path / "theirs").mkdir()
    ours, theirs = Authority(tmp_path / "ours"), Authority(tmp_path / "theirs")
    certificate, key = ours.sign("service")
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    application = Application(
        changed(
            settings, zenoh_listen=endpoint, zenoh_ca=ours.certificate, zenoh_certificate=certificate, zenoh_key=key
        )
    )

    def with_certificate(authority: Authority) -> dict[str, Any]:
        own, own_key = authority.sign("robot")
        return {"connect_certificate": str(own), "connect_private_key": str(own_key), "enable_mtls": True}

    trusting = {"root_ca_certificate": str(ours.certificate)}
    with running(application):
        until(lambda: seen(endpoint, **{"transport/link/tls": trusting | with_certificate(ours)}), "a friend gets in")
        assert not seen(endpoint, **{"transport/link/tls": trusting})
        assert not seen(endpoint, **{"transport/link/tls": trusting | with_certificate(theirs)})
    application.close()


def test_a_replica_shows_its_name_and_password_and_one_without_is_not_let_in(
    settings: Settings, tmp_path: Path
) -> None:
    (tmp_path / "users").write_text("replica:sesame\nrobot:hello\n")
    users = {"transport/auth/usrpwd": {"dictionary_file": str(tmp_path / "users"), "user": "router", "password": "x"}}
    endpoint = free_endpoint()
    with routing(endpoint, **users):
        robot = {"transport/auth/usrpwd": {"user": "robot", "password": "hello"}}
        for password, let_in in (("sesame", True), ("wrong", False)):
            application = Application(
                changed(settings, zenoh_connect=endpoint, zenoh_user="replica", zenoh_password=password)
            )
            with running(application):
                if let_in:
                    until(lambda: seen(endpoint, **robot), "the replica is there")
                else:
                    assert not seen(endpoint, **robot)
            application.close()
        assert not seen(endpoint, **{"transport/auth/usrpwd": {"user": "robot", "password": "no"}})


def test_an_endpoint_that_is_taken_is_told(settings: Settings) -> None:
    endpoint = free_endpoint()
    application = Application(changed(settings, zenoh_listen=endpoint))
    with (
        session("peer", listen=endpoint),
        pytest.raises(InvalidParameter, match="in use"),
        running(application),
    ):
        pass
    application.close()
