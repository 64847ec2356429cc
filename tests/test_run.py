"""The script at the top: its verbs, and the pins it installs within."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
VERBS = ("demo", "serve", "worker", "test", "bench", "default-model", "setup")
EXTRAS = ("worker", "dev")


def run(*arguments: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run([ROOT / "run", *arguments], capture_output=True, text=True, timeout=60, **options)


def pins() -> dict[str, str]:
    """Each pinned package's version, by its normal name."""
    lines = (ROOT / "docker" / "constraints.txt").read_text().splitlines()
    wanted = [Requirement(line) for line in lines if not line.startswith("#")]
    return {canonicalize_name(pin.name): str(pin.specifier) for pin in wanted}


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def direct_requirements() -> list[Requirement]:
    extras = project()["project"]["optional-dependencies"]
    lines = project()["project"]["dependencies"] + [line for extra in EXTRAS for line in extras[extra]]
    return [Requirement(line) for line in lines + project()["build-system"]["requires"]]


@pytest.mark.parametrize("asked", [(), ("help",), ("--help",)])
def test_help_lists_every_verb(asked):
    answer = run(*asked)
    assert answer.returncode == 0
    assert all(re.search(rf"^  {verb}\b", answer.stdout, re.MULTILINE) for verb in VERBS)


def test_an_unknown_verb_is_refused_with_the_usage():
    answer = run("fly")
    assert answer.returncode == 2
    assert "Usage: ./run" in answer.stderr


def test_help_works_from_any_folder(tmp_path):
    assert run("help", cwd=tmp_path).returncode == 0


def test_continuous_integration_runs_what_a_developer_runs():
    assert "./run test" in (ROOT / ".ci" / "run").read_text()


def test_constraints_are_exact_and_name_no_package_index():
    text = (ROOT / "docker" / "constraints.txt").read_text()
    assert "://" not in text
    assert "index" not in text
    assert all(re.fullmatch(r"==[0-9][^,*]*", pin) for pin in pins().values())


def test_every_direct_dependency_is_pinned_within_its_bounds():
    pinned = pins()
    for wanted in direct_requirements():
        name = canonicalize_name(wanted.name)
        assert name in pinned, f"{name} has no pin in docker/constraints.txt"
        assert wanted.specifier.contains(pinned[name].removeprefix("=="))


def test_every_package_that_comes_along_is_pinned():
    pinned, unpinned = pins(), set()
    todo = [(wanted.name, wanted.extras) for wanted in direct_requirements() if applies(wanted)]
    seen = set()
    while todo:
        name, extras = todo.pop()
        if (name, frozenset(extras)) in seen:
            continue
        seen.add((name, frozenset(extras)))
        if canonicalize_name(name) not in pinned:
            unpinned.add(name)
        for line in importlib.metadata.requires(name) or ():
            wanted = Requirement(line)
            if applies(wanted) or any(applies(wanted, extra) for extra in extras):
                todo.append((wanted.name, wanted.extras))
    assert not unpinned


def applies(wanted: Requirement, extra: str = "") -> bool:
    return wanted.marker is None or wanted.marker.evaluate({"extra": extra})
