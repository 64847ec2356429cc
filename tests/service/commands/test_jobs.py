"""`shape-concepts jobs`: what is asked for becomes the job, and what becomes of it is told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from service.cli import main
from service.jobs import Jobs
from service.settings import Settings


@pytest.fixture
def queue(tmp_path: Path, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Jobs]:
    """The queue, which the environment names as well."""
    monkeypatch.setenv("SHAPE_CONCEPTS_STORE", settings.store)
    monkeypatch.setenv("SHAPE_CONCEPTS_JOBS_URL", settings.jobs_url)
    queue = Jobs(settings.jobs_url)
    yield queue
    queue.close()


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, ("jobs", *arguments))


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        (
            "--name toys --dataset a --dataset b --simulate 9 --labelled c --parent tiny --renderer raycast",
            {
                "name": "toys",
                "datasets": ["a", "b"],
                "simulate": 9,
                "labelled": "c",
                "parent": "tiny",
                "simulation": {"renderer": "raycast"},
            },
        ),
        ("--evaluate tiny:1 --dataset a --robustness", {"model": "tiny:1", "dataset": "a", "robustness": True}),
        ("--simulate 9 --into a --seed 3 --timeout 60", {"dataset": "a", "count": 9, "seed": 3, "timeout": 60}),
    ],
)
def test_every_kind_of_job_can_be_submitted(queue: Jobs, options: str, asked: dict[str, Any]) -> None:
    result = run("submit", *options.split(), "--id", "nightly", "--json")
    assert result.exit_code == 0, result.output
    spec = json.loads(result.stdout)["spec"]
    assert {name: spec[name] for name in asked} == asked
    assert queue.show("nightly").spec.model_dump(mode="json") == spec


@pytest.mark.parametrize(
    ("options", "told", "code"),
    [
        ("", "--name MODEL", 2),
        ("--simulate 9", "--name MODEL", 2),
        ("--evaluate tiny", "one --dataset", 2),
        ("--evaluate tiny --dataset a --dataset b", "one --dataset", 2),
        ("--evaluate tiny --dataset a --name x", "--name", 2),
        ("--into a", "--simulate", 2),
        ("--into a --simulate 2 --dataset b", "--dataset", 2),
        ("--name toys --simulate 2 --robustness", "--robustness", 2),
        ("--name toys", "at least one of", 1),
        ("--name toys --simulate 2 --parent nobody", "nobody", 1),
        ("--evaluate nobody --dataset a", "nobody", 1),
    ],
)
def test_options_that_make_no_job_are_refused(queue: Jobs, options: str, told: str, code: int) -> None:
    result = run("submit", *options.split())
    assert (result.exit_code, told in result.stderr) == (code, True), result.stderr
    assert queue.page().jobs == []


def test_jobs_are_listed_page_by_page(queue: Jobs) -> None:
    for job in ("a", "b", "c"):
        run("submit", "--simulate", "2", "--into", job, "--id", job)
    first = run("list", "--limit", "2")
    assert "--before b" in first.stdout
    assert json.loads(run("list", "--before", "b", "--json").stdout)["next"] is None
    assert [job["id"] for job in json.loads(run("list", "--before", "b", "--json").stdout)["jobs"]] == ["a"]
    queue.cancel("a")
    assert [job["id"] for job in json.loads(run("list", "--state", "cancelled", "--json").stdout)["jobs"]] == ["a"]


def test_a_job_is_watched_to_its_end_and_the_exit_code_tells_how_it_ended(queue: Jobs) -> None:
    run("submit", "--simulate", "2", "--into", "toys", "--id", "one")
    queue.note("one", "a line")
    assert run("cancel", "one").stdout == "Job one is cancelled.\n"
    watched = run("watch", "one")
    assert watched.exit_code == 1
    assert [line.partition("Z ")[2] for line in watched.stdout.splitlines()] == ["a line", "cancelled"]
    assert "cancelled" in watched.stderr
    told = [json.loads(line) for line in run("watch", "one", "--json").stdout.splitlines()]
    assert told[-1]["job"]["state"] == "cancelled"
    assert [json.loads(line)["number"] for line in run("logs", "one", "--json").stdout.splitlines()] == [1, 2]
    assert run("retry", "one").stdout == "Job one is queued.\n"
    assert run("report", "one", "--out", "report").exit_code == 1


def test_what_nobody_submitted_is_told(queue: Jobs) -> None:
    for command in ("show", "watch", "logs", "cancel", "retry"):
        result = run(command, "nobody")
        assert (result.exit_code, "There is no job 'nobody'" in result.stderr) == (1, True)
