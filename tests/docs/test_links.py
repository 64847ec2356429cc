"""What the documents point at is there: files, headings, commands with their options, variables, figures."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from service.cli import main as service
from service.settings import Settings
from tests.conftest import ROOT
from worker.cli import main as worker

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BENCHMARKS = [ROOT / "tests" / "benchmarks" / name for name in ("RESULTS.md", "QUALITY.md")]
PROGRAMS: dict[str, click.Command] = {"shape-concepts": service, "shape-concepts-worker": worker}
OTHERS = ("SHAPE_CONCEPTS_DATA",)  # of the tests
pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def anchors(page: Path) -> set[str]:
    """What GitHub calls the headings of a page."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pages
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith(("http://", "https://")):
            continue
        file, _, anchor = target.partition("#")
        found = (page.parent / file).resolve() if file else page
        assert found.exists(), target
        if anchor:
            assert anchor in anchors(found), target


@pages
def test_every_file_that_is_named_is_there(page: Path) -> None:
    named = re.findall(r"`((?:service|worker|tests|docs|docker|proto)/[\w./-]*)`", page.read_text())
    for path in named:
        assert (ROOT / path).exists(), path


def called(page: Path) -> Iterator[list[str]]:
    """The words of every command of ours that a page shows."""
    text = page.read_text()
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    for line in lines:
        for found in re.findall(
            r"(?:^|[(;]|&&|[$] |\w=\S* )\s*(shape-concepts(?:-worker)? [^|;&<>#]*)", line.replace("\\|", "|")
        ):
            yield shlex.split(re.sub(r"\$\(.*?\)|[()]|\.\.\.", "", found).replace("'{", "'").rstrip(), posix=True)


@pages
def test_every_command_and_option_that_is_shown_exists(page: Path) -> None:
    for name, *words in called(page):
        command = PROGRAMS[name]
        while isinstance(command, click.Group) and words and not words[0].startswith("-"):
            assert words[0] in command.commands, f"{name} {' '.join(words)}"
            command = command.commands[words.pop(0)]
        known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)} | {"--help"}
        for word in words:
            if word.startswith("--"):
                assert word.partition("=")[0] in known, f"{command.name} {word}"


@pages
def test_every_variable_that_is_named_is_a_setting(page: Path) -> None:
    for variable in re.findall(r"SHAPE_CONCEPTS_[A-Z_]+[A-Z]", page.read_text()):
        assert variable.removeprefix("SHAPE_CONCEPTS_").lower() in Settings.model_fields or variable in OTHERS, variable


def test_figures_of_quality_are_those_of_the_benchmarks() -> None:
    measured = {number for page in BENCHMARKS for number in re.findall(r"\d\.\d+", page.read_text())}
    told = re.findall(r"\b0\.\d{2,}\b", (ROOT / "docs" / "paper.md").read_text())
    assert len(told) > 50
    assert set(told) - {"0.025"} <= measured, set(told) - measured


def test_the_readme_leads_to_every_document() -> None:
    readme = (ROOT / "README.md").read_text()
    for page in PAGES[1:]:
        assert f"](docs/{page.name})" in readme, page.name
