"""What is said while work is done, where stderr is no terminal."""

from __future__ import annotations

import time

import pytest

from service import progress
from service.progress import watched


@pytest.mark.parametrize(("number", "takes", "said"), [(0, 0.3, "mug.ply: compiling\n"), (0, 0.0, ""), (1, 0.3, "")])
def test_only_a_first_piece_that_takes_long_is_excused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], number: int, takes: float, said: str
) -> None:
    monkeypatch.setattr(progress, "LONG", 0.1)
    with watched("mug.ply", number, 2, excuse="compiling") as on_stage:
        on_stage("patches")
        time.sleep(takes)
    time.sleep(0.15)
    assert capsys.readouterr().err == said
