"""What the tests of the command line share: a current folder with clouds, and a store."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings


@pytest.fixture
def folder(tmp_path: Path, settings: Settings, clouds: list[PointCloud], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a cloud and a file that is none; the environment names the store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SHAPE_CONCEPTS_STORE", settings.store)
    monkeypatch.setenv("SHAPE_CONCEPTS_JOBS_URL", f"sqlite:///{tmp_path / 'jobs.sqlite'}")
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "good.ply").write_bytes(write_ply(clouds[0]))
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat ascii 1.0\n")
    return tmp_path
