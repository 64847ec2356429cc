"""A copy of a store is sound, whatever is published while it is made."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from service.engine.errors import ShapeConceptsError
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.keys import KeyStore
from service.objects import Objects
from service.store import ModelStore
from tests.conftest import ROOT
from tests.learnt import learnt, named_clouds
from worker.learning.train import train

SCRIPT = ROOT / "docker" / "copy_store.py"


@pytest.fixture(scope="module")
def copying() -> ModuleType:
    spec = importlib.util.spec_from_file_location("copy_store", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def models() -> list[ShapeModel]:
    """Three models of unlike content."""
    return [learnt(), learnt("paper"), train(named_clouds()[:8], ModelParams()).model]


class Busy(Objects):
    """A store in which something happens after each listing."""

    def __init__(self, folder: Path, happens: Callable[[], None]) -> None:
        super().__init__(folder)
        self._happens = happens

    def keys(self, folder: str, after: str | None = None) -> list[str]:
        found = super().keys(folder, after)
        self._happens()
        return found


def busy(folder: Path, models: list[ShapeModel]) -> Busy:
    """A store of one version, in which the others are published one after the other while it is copied."""
    store, waiting = ModelStore(folder), list(models)

    def publish() -> None:
        if waiting:
            store.publish(waiting.pop(0), name="tiny", seed=5, source={})

    publish()
    return Busy(folder, publish)


def unsound(store: ModelStore) -> list[str]:
    """What a store names and has not."""
    wrong = []
    for reference in ["tiny@production", *(f"tiny:{version}" for version in store.versions("tiny"))]:
        try:
            store.load(*store.resolve(reference))
        except (ShapeConceptsError, FileNotFoundError):
            wrong.append(reference)
    return wrong


def test_what_is_published_while_a_store_is_copied_does_not_break_the_copy(
    tmp_path: Path, models: list[ShapeModel], copying: ModuleType
) -> None:
    source = busy(tmp_path / "store", models)
    list(copying.copy(source, Objects(tmp_path / "copy")))
    copy = ModelStore(tmp_path / "copy")
    assert copy.versions("tiny") == [1, 2]  # the third came after those that name content were listed
    assert copy.resolve("tiny") == ("tiny", 1)
    assert unsound(copy) == []


def test_listed_in_another_order_the_copy_is_broken(
    tmp_path: Path, models: list[ShapeModel], copying: ModuleType
) -> None:
    source, target = busy(tmp_path / "store", models), Objects(tmp_path / "copy")
    for wanted in (copying.CONTENT, copying.NAMING, copying.ALIASES):
        for key in [key for key in source.keys("") if copying.rank(key) == wanted]:
            target.put(key, source.get(key))
    assert unsound(ModelStore(tmp_path / "copy")) == ["tiny@production", "tiny:2"]


def test_whoever_answers_while_a_store_is_restored_sees_no_half_of_it(
    tmp_path: Path, models: list[ShapeModel], copying: ModuleType
) -> None:
    store = ModelStore(tmp_path / "store")
    for model in models:
        store.publish(model, name="tiny", seed=5, source={})
    restored = ModelStore(tmp_path / "restored")
    for _ in copying.copy(Objects(tmp_path / "store"), Objects(tmp_path / "restored")):
        if restored.names():
            assert set(unsound(restored)) <= {"tiny@production"}  # there is no alias yet
    assert restored.resolve("tiny") == ("tiny", 3)
    assert unsound(restored) == []


def test_a_copy_has_everything_and_is_brought_up_to_date(tmp_path: Path, models: list[ShapeModel]) -> None:
    def copied() -> str:
        command = [sys.executable, str(SCRIPT), str(tmp_path / "store"), (tmp_path / "copy").as_uri()]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout

    store, keys = ModelStore(tmp_path / "store"), KeyStore(str(tmp_path / "store"))
    store.publish(models[0], name="tiny", seed=5, source={})
    keys.create("robot", ("answer",))
    assert copied() == "Copied 4 objects.\n"
    store.publish(models[1], name="tiny", seed=5, source={})
    assert copied() == "Copied 6 objects.\n"  # not the first content again

    def files(name: str) -> dict[str, bytes]:
        root = tmp_path / name
        return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}

    assert files("copy") == files("store")


def test_a_store_that_cannot_be_read_is_told_plainly() -> None:
    command = [sys.executable, str(SCRIPT), "nonsense://a", "nonsense://b"]
    refused = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert refused.returncode == 1
    assert refused.stderr.startswith("The store nonsense://a cannot be opened")
