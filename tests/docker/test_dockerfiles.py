"""What the Dockerfiles promise, told from their text; `docker/prove.py` does what they say."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.conftest import ROOT

DOCKER = ROOT / "docker"
BUILD_TOOLS = {"build-essential", "gcc", "g++", "git", "make", "pip", "python3-dev", "python3-pip", "python3-venv"}
images = pytest.mark.parametrize("image", ["api", "worker"])


def reader() -> ModuleType:
    """docker/dockerfile.py: a folder of that name cannot be imported from, as there is a library of the same name."""
    if found := sys.modules.get("dockerfile"):
        return found
    spec = importlib.util.spec_from_file_location("dockerfile", DOCKER / "dockerfile.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["dockerfile"] = module
    spec.loader.exec_module(module)
    return module


def seen(image: str) -> set[str]:
    """The files of the project that the build of an image sees."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    paths = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    ignore = (DOCKER / f"{image}.Dockerfile.dockerignore").read_text()
    return set(reader().context(paths, ignore))


@images
def test_the_linter_of_dockerfiles_has_nothing_to_say(image: str) -> None:
    hadolint = Path(sys.executable).with_name("hadolint")
    command = [str(hadolint), "--config", str(DOCKER / "hadolint.yaml"), str(DOCKER / f"{image}.Dockerfile")]
    linted = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert linted.returncode == 0, linted.stdout


@images
def test_a_container_is_nobody_special_and_tells_its_health(image: str) -> None:
    last = reader().read(DOCKER / f"{image}.Dockerfile")[-1]
    assert re.fullmatch(r"[1-9]\d+:[1-9]\d+", last.said("USER")[-1])  # a number: Kubernetes checks that it is not 0
    assert last.health()
    assert last.command()[0].startswith("shape-concepts")


@images
def test_no_build_tool_is_installed_where_the_image_ends(image: str) -> None:
    build, last = reader().read(DOCKER / f"{image}.Dockerfile")
    words = set(" ".join(last.said("RUN")).split())
    assert "install" in words
    assert not words & BUILD_TOOLS
    assert set(" ".join(build.said("RUN")).split()) & BUILD_TOOLS  # so that this test can fail
    assert any(reader().copied(text).stage == "build" for text in last.said("COPY"))


@images
def test_what_is_copied_is_seen_by_the_build(image: str) -> None:
    files = seen(image)
    for stage in reader().read(DOCKER / f"{image}.Dockerfile"):
        for copy in map(reader().copied, stage.said("COPY")):
            for source in copy.sources:
                assert copy.stage or any(path == source or path.startswith(f"{source}/") for path in files), source


def test_the_image_of_the_service_is_built_without_the_worker() -> None:
    assert any(path.startswith("service/engine/") for path in seen("api"))
    assert not [path for path in seen("api") if path.startswith(("worker/", "tests/"))]
    assert any(path.startswith("worker/learning/") for path in seen("worker"))


@images
def test_the_libraries_are_pinned_and_those_of_the_project(image: str) -> None:
    build = reader().read(DOCKER / f"{image}.Dockerfile")[0]
    installs = [line for line in build.said("RUN") if "pip" in line and " install" in line]
    assert all("--constraint docker/constraints.txt" in line or "--no-deps" in line for line in installs)
    extras = next(re.findall(r"requirements\.py ([a-z ]+)>", line)[0].split() for line in installs if ".py" in line)
    command = [sys.executable, str(DOCKER / "requirements.py"), *extras]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    pinned = {line.partition("==")[0] for line in (DOCKER / "constraints.txt").read_text().splitlines()}
    names = {re.split(r"[^A-Za-z0-9._-]", line)[0] for line in listed}
    assert names <= pinned
    assert ("sapien" in names) == (image == "worker")


@images
def test_all_that_is_compiled_at_the_build_is_found_by_whoever_runs_the_image(image: str) -> None:
    environment = reader().read(DOCKER / f"{image}.Dockerfile")[-1].environment()
    assert environment["NUMBA_CPU_NAME"] == "generic"
    assert environment["NUMBA_CPU_FEATURES"] == ""


def test_the_last_matching_line_says_whether_a_build_sees_a_file() -> None:
    paths = ["a.py", "b/c.py", "b/__pycache__/c.pyc", "d/e/f.txt", "bb/c.py"]
    context = reader().context
    assert context(paths, "") == paths
    assert context(paths, "*\n!b\n# a comment\n**/__pycache__") == ["b/c.py"]
    assert context(paths, "**/*.py") == ["b/__pycache__/c.pyc", "d/e/f.txt"]
    assert context(paths, "*\n!d/e/f.txt\n!a.*") == ["a.py", "d/e/f.txt"]


def test_an_instruction_that_is_not_understood_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "Dockerfile"
    file.write_text("FROM debian:trixie-slim AS one\n# comment\nRUN a \\\n    && b\nENV X=1 Y='two words'\n")
    (stage,) = reader().read(file)
    assert (stage.base, stage.name) == ("debian:trixie-slim", "one")
    assert stage.environment() == {"X": "1", "Y": "two words"}
    assert [step.rest.split() for step in stage.steps if step.word == "RUN"] == [["a", "&&", "b"]]
    file.write_text("FROM debian\nADD https://example.com/x /x\n")
    with pytest.raises(ValueError, match="ADD"):
        reader().read(file)
    with pytest.raises(ValueError, match="--chown"):
        reader().copied("--chown=1 a b")


def test_the_worker_has_the_system_libraries_that_a_checkout_gets() -> None:
    text = (ROOT / "run").read_text()
    wanted = " ".join(re.findall(r"^readonly (?:libraries|vulkan)=\(([^)]*)\)", text, re.M)).split()
    installed = " ".join(reader().read(DOCKER / "worker.Dockerfile")[-1].said("RUN")).split()
    assert len(wanted) > 5
    assert set(wanted) <= set(installed)
