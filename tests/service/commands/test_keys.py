"""Access keys on the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path

from tests.service.commands.asked import run


def test_a_key_is_shown_once_and_its_secret_in_no_list(folder: Path) -> None:
    made = run("keys", "create", "robot-7", "--scope", "answer", "--scope", "train", "--rate", "5")
    assert made.exit_code == 0
    text = made.stdout.strip()
    assert re.fullmatch(r"sc_[0-9a-f]{12}_[A-Za-z0-9_-]{43}", text)
    (key,) = json.loads(run("keys", "list", "--json").stdout)["keys"]
    assert (key["name"], key["scopes"], key["rate"], key["revoked"]) == ("robot-7", ["answer", "train"], 5, False)
    assert run("keys", "revoke", key["id"]).exit_code == 0
    listed = run("keys", "list")
    assert "revoked" in listed.stdout
    assert text.split("_", 2)[2] not in listed.stdout + json.dumps(key)


def test_the_limits_of_a_key_are_told(folder: Path) -> None:
    made = run("keys", "create", "cameras", "--max-body", "4000000", "--max-points", "300000", "--max-batch", "8")
    assert made.exit_code == 0
    (key,) = json.loads(run("keys", "list", "--json").stdout)["keys"]
    assert (key["max_body"], key["max_points"], key["max_batch"]) == (4_000_000, 300_000, 8)
    listed = " ".join(run("keys", "list").stdout.replace("│", " ").split())
    for limit in ("4000000", "300000", "8"):
        assert limit in listed
    refused = run("keys", "create", "cameras", "--max-points", "3")
    assert refused.exit_code != 0
    assert "max_points" in refused.stderr


def test_a_key_that_is_not_there_cannot_be_revoked(folder: Path) -> None:
    result = run("keys", "revoke", "0123456789ab")
    assert result.exit_code == 1
    assert "keys list" in result.stderr
