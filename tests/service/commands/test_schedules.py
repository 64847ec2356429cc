"""Schedules on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.service.commands.asked import lines, run


def test_a_schedule_is_made_looked_at_paused_and_removed(folder: Path) -> None:
    assert run("schedules", "list", "--json").stdout == '{"schedules": []}\n'
    assert not (folder / "jobs.sqlite").exists()
    times = ("weekly", "--cron", "0 3 * * mon", "--zone", "Europe/Berlin")
    for _ in range(2):
        made = run("schedules", "create", *times, "--job", '{"name": "toys", "simulate": 2}')
        assert made.exit_code == 0, made.output
        assert "Schedule weekly is active; next due" in made.stdout
    (shown,) = lines(run("schedules", "show", "weekly", "--json"))
    assert (shown["cron"], shown["zone"], shown["job"]["simulate"]) == ("0 3 * * mon", "Europe/Berlin", 2)
    assert lines(run("schedules", "list", "--json"))[0]["schedules"] == [shown]
    assert "weekly" in run("schedules", "list").stdout
    assert "simulate" in run("schedules", "show", "weekly").stdout
    assert lines(run("schedules", "pause", "weekly", "--json"))[0]["next_due"] is None
    assert "active" in run("schedules", "resume", "weekly").stdout
    assert run("schedules", "delete", "weekly").exit_code == 0
    refused = run("schedules", "show", "weekly")
    assert (refused.exit_code, "There is no schedule 'weekly'" in refused.stderr) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--cron", "soon", "--job", '{"name": "toys", "simulate": 2}'), "no cron expression"),
        (("--cron", "0 3 * * mon", "--job", "[1]"), "No such file"),
        (("--cron", "0 3 * * mon", "--job", "{"), "no JSON"),
        (("--cron", "0 3 * * mon", "--job", '{"name": "toys"}'), "at least one of"),
        (("--cron", "0 3 * * mon", "--job", '{"name": "toys", "extend": "nobody"}'), "There is no 'nobody@production'"),
    ],
)
def test_a_schedule_that_cannot_be_says_why(folder: Path, arguments: tuple[str, ...], said: str) -> None:
    refused = run("schedules", "create", "weekly", *arguments)
    assert refused.exit_code == 1
    assert said in refused.stderr
