"""The model that comes with the service: whole, of this version, and there until the store holds one."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pytest
from click.testing import CliRunner

from service.application import Application, CloudFile
from service.built_in import built_in
from service.cli import main
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import ModelDamaged, ModelIncompatible, ModelNotFound
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.settings import Settings
from service.store import SHIPPED, ModelStore
from service.transports.rest.examples import CLOUD_XYZ
from tests.conftest import ROOT

CLOUD = CloudFile(CLOUD_XYZ.encode(), "xyz")
RENEW = "the model in service/default_model is not of this version: learn it anew with ./run default-model"
LARGEST = 6_000_000  # bytes that it may add to the repository and to each installation


@pytest.fixture
def settings(settings: Settings, tmp_path: Path) -> Settings:
    return settings.model_copy(update={"store": str(tmp_path / "new"), "model": None})


@pytest.fixture(scope="module")
def shipped() -> ShapeModel:
    try:
        return built_in().load(*built_in().resolve("default"))[0]
    except (ModelDamaged, ModelIncompatible, ModelNotFound) as error:
        pytest.fail(f"{RENEW} ({error})")


def test_it_is_whole_and_of_this_version(shipped: ShapeModel) -> None:
    assert built_in().resolve("default") == ("default", 1)
    manifest = built_in().manifest("default", 1)
    assert shipped.params == ModelParams(), RENEW
    assert (manifest.source["kind"], manifest.source["clouds"]) == ("simulation", 250)
    assert sum(file.stat().st_size for file in SHIPPED.rglob("*")) < LARGEST


def test_the_command_that_learns_it_is_the_one_documented() -> None:
    manifest = built_in().manifest("default", 1)
    line = next(line for line in (ROOT / "run").read_text().splitlines() if "--name default" in line)
    assert f"--simulate {manifest.source['clouds']} --seed {manifest.seed} " in line
    assert manifest.source["seed"] == manifest.seed
    assert "./run default-model" in (ROOT / "README.md").read_text()


def test_on_a_new_machine_a_cloud_is_answered(application: Application, shipped: ShapeModel) -> None:
    answer = application.respond(CLOUD)
    assert (answer.model, answer.version) == ("default", 1)
    assert len(answer.concepts) == len(shipped.respond(PointCloud(points())).concept_ids) > 10
    ready = application.ready()
    assert (ready.model, ready.version, ready.models, ready.built_in) == ("default", 1, ["default"], True)
    assert [(each.name, each.built_in) for each in application.models.all()] == [("default", True)]
    assert application.models.manifest("default", 1).seed == 7
    assert application.looking.thumbnail("default", 1, 0).shape == (48, 48)
    assert not Path(application.settings.store).exists()


def points() -> np.ndarray:
    return np.loadtxt(CLOUD_XYZ.splitlines(), dtype=np.float32)


def test_the_command_line_answers_without_any_model_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clouds: list[PointCloud]
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.delenv("SHAPE_CONCEPTS_STORE", raising=False)
    (tmp_path / "mug.ply").write_bytes(write_ply(clouds[0]))
    answered = CliRunner().invoke(main, ["respond", "--json", str(tmp_path / "mug.ply")])
    assert answered.exit_code == 0, answered.output
    assert json.loads(answered.stdout)["model"] == "default"
    assert "built in" in CliRunner().invoke(main, ["models", "list"]).stdout
    assert not (tmp_path / "data").exists()


def test_a_store_with_a_model_of_its_own_wins_whatever_its_name(
    application: Application, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    assert application.respond(CLOUD).model == "default"
    store = ModelStore(application.settings.store)
    store.publish(model, name="default", seed=1, source={})
    for _ in range(40):  # what was read of the store is believed for a second
        answer = application.respond(clouds[0])
        if answer.responses == model.respond(clouds[0]).responses.tolist():
            break
        time.sleep(0.1)
    assert answer.responses == model.respond(clouds[0]).responses.tolist()
    assert not application.ready().built_in
    assert [each.built_in for each in application.models.all()] == [False]
    assert application.models.manifest("default", 2).seed == 1
    assert answer.version == 2, "default:1 is the built-in one, wherever it is asked"


def test_while_the_first_model_is_published_every_request_is_answered_by_one_or_the_other(
    application: Application, model: ShapeModel
) -> None:
    application.respond(CLOUD)
    ModelStore(application.settings.store).publish(model, name="late", seed=1, source={})
    until = time.monotonic() + 5
    seen = [application.respond(CLOUD).model]
    while seen[-1] != "late" and time.monotonic() < until:
        seen.append(application.respond(CLOUD).model)
    assert seen[-1] == "late"
    assert set(seen) <= {"default", "late"}


class TestSwitchedOff:
    @pytest.fixture
    def application(self, settings: Settings) -> Iterator[Application]:
        application = Application(settings.model_copy(update={"built_in": False}))
        yield application
        application.close()

    def test_a_store_without_models_answers_nothing(self, application: Application) -> None:
        with pytest.raises(ModelNotFound, match="train and publish"):
            application.respond(CLOUD)
        assert application.models.all() == []


def test_nobody_publishes_into_it(application: Application) -> None:
    before = sorted(SHIPPED.rglob("*"))
    with pytest.raises(ModelNotFound):
        application.models.promote("default:1", "staging")
    with pytest.raises(ModelNotFound):
        application.models.rollback("default")
    assert sorted(SHIPPED.rglob("*")) == before


def test_an_installation_brings_it_along(tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]
    copytree(ROOT / "service", tmp_path / "a" / "service", ignore=ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (tmp_path / "a" / name).write_bytes((ROOT / name).read_bytes())
    code = f"import {project['build-backend']} as backend; backend.build_wheel({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path / "a", check=True, capture_output=True, timeout=120)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        found = {name for name in packed.namelist() if name.startswith("service/default_model/")}
        wanted = {file.relative_to(ROOT).as_posix() for file in SHIPPED.rglob("*") if file.is_file()}
        assert found == wanted
        for name in wanted:
            assert packed.read(name) == (ROOT / name).read_bytes()
        pages = {file.relative_to(ROOT).as_posix() for file in (ROOT / "service/pictures/page").iterdir()}
        assert pages <= set(packed.namelist())
