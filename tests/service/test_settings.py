"""Every setting can be set, is described, and has a bound where one is needed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from service.settings import Settings, default_store


def test_every_setting_is_described() -> None:
    for name, field in Settings.model_fields.items():
        assert field.description, name


def test_every_setting_is_read_from_the_environment_under_one_prefix(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {
        "store": "s3://models/x",
        "jobs_url": "postgresql://worker@database/jobs",
        "cluster": "tcp://10.0.0.1:8786",
        "worker_lease": "12.5",
        "built_in": "False",
        "model": "mugs@staging",
        "host": "0.0.0.0",
        "port": "9000",
        "grpc_port": "-1",
        "access": "keys",
        "tls_certificate": "/etc/tls/service.pem",
        "tls_key": "/etc/tls/service.key",
        "workers": "3",
        "queue": "5",
        "max_body": "2048",
        "max_bodies": "4096",
        "body_timeout": "1.5",
        "body_pause": "0.5",
        "max_batch": "7",
        "max_archive": "5000",
        "max_unpacked": "6000",
        "max_entries": "70",
        "archive_timeout": "90.5",
        "max_points": "1000",
        "max_objects": "7",
        "loaded_models": "2",
        "log_format": "json",
        "log_level": "error",
        "zenoh_mode": "router",
        "zenoh_config": "zenoh.json5",
        "zenoh_user": "replica",
        "zenoh_ca": "ca.pem",
        "zenoh_certificate": "own.pem",
        "zenoh_key": "own.key",
    }
    structured = {"zenoh_connect", "zenoh_listen", "zenoh_password", "streams"}
    assert set(given) | structured == set(Settings.model_fields)
    for name, value in given.items():
        monkeypatch.setenv(f"SHAPE_CONCEPTS_{name.upper()}", value)
    settings = Settings()
    assert {name: str(getattr(settings, name)) for name in given} == given


def test_lists_are_separated_by_commas_and_streams_are_json(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_ZENOH_CONNECT", "tcp/10.0.0.1:7447, tls/router:7447,")
    monkeypatch.setenv("SHAPE_CONCEPTS_ZENOH_LISTEN", "tcp/0.0.0.0:7448")
    monkeypatch.setenv("SHAPE_CONCEPTS_STREAMS", '[{"key": "robots/*/cloud", "model": "mugs", "share": "cloud"}]')
    settings = Settings()
    assert settings.zenoh_connect == ("tcp/10.0.0.1:7447", "tls/router:7447")
    assert settings.zenoh_listen == ("tcp/0.0.0.0:7448",)
    assert [(stream.key, stream.model, stream.share) for stream in settings.streams] == [
        ("robots/*/cloud", "mugs", "cloud")
    ]


@pytest.mark.parametrize(
    "stream",
    [
        "{}",
        '{"key": ""}',
        '{"key": "a", "publish_to": "{key}"}',
        '{"key": "a", "publish_to": "b"}',
        '{"key": "a", "x": 1}',
    ],
)
def test_a_stream_that_cannot_be_is_refused(monkeypatch: pytest.MonkeyPatch, stream: str) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_STREAMS", f"[{stream}]")
    with pytest.raises(ValidationError, match="streams"):
        Settings()


def test_a_password_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_ZENOH_PASSWORD", "open sesame")
    settings = Settings()
    assert settings.zenoh_password is not None
    assert settings.zenoh_password.get_secret_value() == "open sesame"
    assert "sesame" not in repr(settings)


def test_an_empty_variable_is_as_good_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_PORT", "")
    assert Settings().port == 8000


def test_the_store_is_in_the_users_data_directory_by_default(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("SHAPE_CONCEPTS_STORE", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert Settings().store == default_store() == str(tmp_path / "shape-concepts")
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_store() == str(tmp_path / ".local" / "share" / "shape-concepts")


def test_the_service_is_reachable_from_this_machine_alone_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SHAPE_CONCEPTS_HOST", raising=False)
    assert re.fullmatch(r"127\.\d+\.\d+\.\d+", Settings().host)


@pytest.mark.parametrize(("name", "value"), [("port", "65536"), ("workers", "0"), ("max_body", "-1"), ("queue", "x")])
def test_a_setting_out_of_its_bounds_is_refused(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(f"SHAPE_CONCEPTS_{name.upper()}", value)
    with pytest.raises(ValidationError, match=name):
        Settings()
