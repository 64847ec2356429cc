"""Every setting, parameter and field of a job is in docs/settings.md, with the default that it has."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from service.engine.params import ModelParams
from service.job_specs import EvaluateSpec, SimulateSpec, TrainSpec
from service.settings import Settings
from service.streams import Stream
from tests.conftest import ROOT
from worker.config import read_config
from worker.simulation.params import SimulationParams

PAGE = ROOT / "docs" / "settings.md"
RENEW = "docs/settings.md is not what the code says: python docs/settings.py"


def rows(heading: str) -> dict[str, dict[str, str]]:
    """The table below a heading: by name, what stands in each column."""
    section = PAGE.read_text().partition(f"{heading}\n")[2]
    table = [line for line in re.split(r"\n#", section)[0].splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table]
    return {row[0].strip("`"): dict(zip(cells[0], row, strict=True)) for row in cells[1:]}


def nested() -> Iterator[tuple[str, type[BaseModel]]]:
    yield "## Streams", Stream
    for stage, params in ModelParams():
        yield f"### `[{stage}]`", type(params)
    yield "## The simulation", SimulationParams
    for part, params in SimulationParams():
        if isinstance(params, BaseModel):
            yield f"### `[simulation.{part}]`", type(params)
    for spec in (TrainSpec, EvaluateSpec, SimulateSpec):
        yield f'### `"kind": "{spec.model_fields["kind"].default}"`', spec


def check(documented: dict[str, dict[str, str]], model: type[BaseModel], prefix: str = "") -> None:
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel) or name in ("kind", "timeout", "attempts"):
            continue
        row = documented[f"{prefix}{name.upper()}" if prefix else name]
        assert row["what"], name
        default = row["default"].partition("` (")[0].strip("`")
        if field.is_required():
            assert default == "*must be given*", name
        elif default == "none":
            assert field.default in (None, ()), name
        elif isinstance(field.default, str):
            assert default == field.default, name
        elif field.default_factory is None:
            assert type(field.default)(json.loads(default)) == field.default, name


def test_every_setting_is_told_with_its_default() -> None:
    check(rows("## Settings of the service"), Settings, "SHAPE_CONCEPTS_")


@pytest.mark.parametrize(("heading", "model"), list(nested()), ids=lambda value: str(getattr(value, "__name__", "")))
def test_every_parameter_and_field_is_told_with_its_default(heading: str, model: type[BaseModel]) -> None:
    check(rows(heading), model)


def test_what_all_jobs_have_is_told() -> None:
    assert {name: row["default"] for name, row in rows("### All jobs").items()} == {
        "timeout": "none",
        "attempts": f"`{TrainSpec.model_fields['attempts'].default}`",
    }


def test_the_page_is_what_its_command_writes(tmp_path: Path) -> None:
    copy = tmp_path / "settings.py"
    copy.write_bytes((ROOT / "docs" / "settings.py").read_bytes())
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, copy], check=True, capture_output=True, timeout=120, env=environment)
    assert (tmp_path / "settings.md").read_text() == PAGE.read_text(), RENEW


def test_the_configuration_that_is_shown_is_taken(tmp_path: Path) -> None:
    shown = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert shown is not None
    file = tmp_path / "parameters.toml"
    file.write_text(shown[1])
    config, said = read_config(file), tomllib.loads(shown[1])
    assert config.model.stimuli.sigma == said["stimuli"]["sigma"]
    assert config.model.dictionary == ModelParams.preset("paper").dictionary
    assert list(config.simulation.orders) == said["simulation"]["orders"]
