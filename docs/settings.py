"""Writes docs/settings.md: every setting, parameter and field of a job, as the code has it.

`python docs/settings.py` writes the page anew; a test fails if it differs from what is committed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from service.engine.params import ModelParams
from service.job_specs import EvaluateSpec, SimulateSpec, TrainSpec
from service.settings import MEBIBYTE, Settings
from service.streams import Stream
from worker.simulation.params import SimulationParams

OUT = Path(__file__).with_name("settings.md")
COMPUTED = {  # defaults that depend on the machine, or are told elsewhere
    "store": "the folder `shape-concepts` in the user's data directory",
    "jobs_url": "the file `jobs.sqlite` in the folder of the default store",
    "workers": "the number of cores",
    "params": "the defaults of [all stages](#parameters-of-a-model)",
    "simulation": "the defaults of [the simulation](#the-simulation)",
}
BYTES = ("max_body", "max_bodies", "max_archive", "max_unpacked")
COMMON = ("kind", "timeout", "attempts")  # of all jobs
INTRODUCTION = """# Settings

Every setting of the service, every parameter of a model, every field of a job, with its default. This page is written
by `python docs/settings.py` from the code; a test keeps the two the same.

- [Settings of the service](#settings-of-the-service): environment variables.
- [Streams](#streams): what each of the service's streams may have.
- [Parameters of a model](#parameters-of-a-model) and [the simulation](#the-simulation): what training takes from
  `--config FILE`, or a job from `params` and `simulation`.
- [Fields of a job](#fields-of-a-job): what `POST /v1/jobs`, a schedule's `--job` and gRPC take.
"""
SETTINGS = """## Settings of the service

Environment variables of every command, the service and the worker among them. Options go before them where a command
has them: `--host`, `--port`, `--grpc-port`, `--store`, `--model`, `--cluster`. An empty variable is as good as none. A
value that cannot be is refused at the start, by name.

Variables of others hold as well: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION` and `AWS_ENDPOINT_URL` for
a store in a bucket, those of [OpenTelemetry](operations.md#metrics-logs-and-traces) for traces.
"""
STREAMS = """## Streams

`SHAPE_CONCEPTS_STREAMS` is a JSON list of these; `key` alone is enough. What they do, [robots.md](robots.md) tells.
"""
PARAMETERS = """## Parameters of a model

A file for `shape-concepts-worker train --config FILE`, TOML or JSON, names a preset and what differs from it, a table
for each stage; a job has the same tables in its field `params`, without a preset:

```toml
preset = "paper"        # or "default", which goes without saying

[stimuli]
sigma = 0.05

[simulation]            # where objects are simulated
orders = [1, 2, 3]
```

A version's manifest (`shape-concepts models show NAME`) has all of them, so that a model always tells how it was made.
The column *paper* is what `preset = "paper"` has where that is another value; why, [paper.md](paper.md) tells.
"""
SIMULATION = """## The simulation

`[simulation]` and, below it, `[simulation.prototypes]`, `[simulation.camera]` and `[simulation.sensor]`. On the command
line, `--orders`, `--noise` and `--renderer` go before them.
"""
JOBS = """## Fields of a job

As JSON: `{"kind": "train", "name": "mine", "datasets": ["scans"]}`; a job without a kind trains. On the command line
these are the options of `shape-concepts jobs submit`.
"""


def write() -> str:
    """The page."""
    parts = [INTRODUCTION, SETTINGS, _table(Settings, prefix="SHAPE_CONCEPTS_"), STREAMS, _table(Stream), PARAMETERS]
    paper = ModelParams.preset("paper")
    for stage, params in ModelParams():
        parts += [f"### `[{stage}]`\n\n{_first(params)}\n", _table(type(params), paper=getattr(paper, stage))]
    simulation = SimulationParams.preset("paper")
    nested = [name for name, value in SimulationParams() if isinstance(value, BaseModel)]
    parts += [SIMULATION, _table(SimulationParams, without=nested)]
    for name in nested:
        own = getattr(SimulationParams(), name)
        parts += [
            f"### `[simulation.{name}]`\n\n{_first(own)}\n",
            _table(type(own), paper=getattr(simulation, name)),
        ]
    parts += [JOBS, "### All jobs\n", _table(TrainSpec, only=("timeout", "attempts"))]
    for spec in (TrainSpec, EvaluateSpec, SimulateSpec):
        kind = spec.model_fields["kind"].default
        parts += [f'### `"kind": "{kind}"`\n\n{_first(spec)}\n', _table(spec, without=COMMON)]
    return "\n".join(parts)


def _first(documented: object) -> str:
    """The first paragraph of a docstring, in one line."""
    return " ".join((documented.__doc__ or "").strip().partition("\n\n")[0].split())


def _table(
    model: type[BaseModel],
    *,
    prefix: str = "",
    paper: BaseModel | None = None,
    without: tuple[str, ...] | list[str] = (),
    only: tuple[str, ...] = (),
) -> str:
    """A row for each field of a model.

    Args:
        model: that has the fields.
        prefix: of the variable that sets a field; without one the field's own name is told.
        paper: the values of the preset `paper`, where they are told as well.
        without: fields that are told elsewhere.
        only: the fields that are told; all for none.
    """
    schema = model.model_json_schema(mode="validation")["properties"]
    names = [name for name in model.model_fields if name not in without and (not only or name in only)]
    differs = paper is not None and any(getattr(paper, name) != model.model_fields[name].default for name in names)
    lines = ["| name | values | default | paper | what |" if differs else "| name | values | default | what |"]
    lines.append("|---|---|---|---|---|" if differs else "|---|---|---|---|")
    for name in names:
        field = model.model_fields[name]
        cells = [f"`{prefix}{name.upper() if prefix else name}`", _values(schema[name]), _default(name, field)]
        if differs:
            own = getattr(paper, name)
            cells.append("" if own == field.default else _code(own))
        description = field.description or schema[name].get("description", "")
        lines.append("| " + " | ".join([*cells, description.replace("|", "\\|")]) + " |")
    return "\n".join(lines) + "\n"


def _default(name: str, field: FieldInfo) -> str:
    if field.is_required():
        return "*must be given*"
    if field.default_factory is not None:
        return COMPUTED[name]
    if field.default in (None, ()):
        return "none"
    if name in BYTES:
        return f"`{field.default}` ({field.default // MEBIBYTE} MiB)"
    return _code(field.default)


def _code(value: object) -> str:
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


def _values(schema: dict[str, Any]) -> str:
    """What a field may be: its kind, and its bounds."""
    choices = [each for each in schema.get("anyOf", [schema]) if each.get("type") != "null"]
    kind = next((each for each in choices if each.get("type") != "string"), choices[0])
    if "enum" in kind:
        return ", ".join(f"`{value}`" for value in kind["enum"])
    names = {"integer": "whole number", "number": "number", "boolean": "`true`, `false`", "string": "text"}
    if kind.get("type") == "array":
        return f"list of {_plural(kind.get('items', {}))}"
    if "$ref" in kind or kind.get("type") == "object":
        return "table"
    bounds = [
        f"{sign} {_number(kind[bound])}"
        for bound, sign in (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))
        if bound in kind
    ]
    return ", ".join([names[kind["type"]], *bounds])


def _plural(items: dict[str, Any]) -> str:
    return {"integer": "whole numbers", "number": "numbers", "string": "texts"}.get(items.get("type", ""), "tables")


def _number(value: float) -> str:
    if value == 2**63 - 1:
        return "2^63 - 1"
    return f"{int(value):,}" if value >= 10_000 else f"{value:g}"


if __name__ == "__main__":
    OUT.write_text(write(), encoding="utf-8")
