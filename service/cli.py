"""The command line of the service: `shape-concepts`.

What a command needs is imported when it runs, so that `--help` answers at once. Results go to stdout, everything
else to stderr. Exit codes: 0 all went well, 1 something failed, 2 the command was not understood.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from service import __version__
from service.engine.errors import InvalidParameter, ModelNotFound, ShapeConceptsError, UnreadableCloud
from service.progress import watched

if TYPE_CHECKING:
    from service.application import Application
    from service.settings import Settings

Command = TypeVar("Command", bound=Callable[..., Any])


class ReportingGroup(click.Group):
    """Commands whose foreseen failures are one line on stderr and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Runs a command."""
        try:
            return super().invoke(ctx)
        except ShapeConceptsError as error:
            place = f" (store: {ctx.obj})" if isinstance(error, ModelNotFound) and ctx.obj else ""
            raise click.ClickException(f"{error}{place}") from error
        except OSError as error:
            if isinstance(error, BrokenPipeError):
                raise
            raise click.ClickException(f"{error.strerror or error}: {error.filename}") from error


def store_option(command: Command) -> Command:
    """Adds --store."""
    return click.option(
        "--store",
        metavar="URL",
        help="Model store: a folder, file:///folder or s3://bucket/prefix.  [default: SHAPE_CONCEPTS_STORE, or a "
        "folder in the user's data directory]",
    )(command)


def json_option(command: Command) -> Command:
    """Adds --json."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON, for programs.")(command)


def _epilog(*examples: str) -> str:
    """Runnable examples below a command's help."""
    return "\b\nExamples:\n" + "\n".join(f"  shape-concepts {example}" for example in examples)


@click.group(
    cls=ReportingGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog=_epilog("respond --model default mug.pcd", "models list", "serve --port 8000"),
)
@click.version_option(__version__, prog_name="shape-concepts")
def main() -> None:
    """Tells of an object's point cloud which learned shape concepts it resembles.

    Models are named NAME, NAME@ALIAS or NAME:VERSION; a bare NAME means NAME@production.
    """


@main.command(
    epilog=_epilog(
        "respond --model default mug.pcd",
        "respond --model default --top 3 --unit mm scans/*.ply",
        "respond --model default:1 --time 0.2 --json --stimuli mug.npy",
        "respond --viewpoint 0,-0.4,-0.9 --json - < mug.xyz",
    )
)
@click.argument("clouds", nargs=-1, required=True, metavar="CLOUD...")
@click.option("--model", metavar="NAME", help="Model to ask.  [default: SHAPE_CONCEPTS_MODEL, or the store's only one]")
@click.option(
    "--time", type=click.FloatRange(0, 1), help="Filtration time: 0 specific, 1 generic.  [default: epsilon_max]"
)
@click.option("--top", type=click.IntRange(min=1), help="How many concepts to list.  [default: all]")
@click.option("--unit", default="m", show_default=True, help="Unit of the coordinates: m, dm, cm, mm, um, in, ft.")
@click.option(
    "--viewpoint", metavar="POSE", help="Sensor pose in the cloud's frame and unit: x,y,z or x,y,z,qw,qx,qy,qz."
)
@click.option("--stimuli", is_flag=True, help="With --json: the stimuli vector as well.")
@json_option
@store_option
def respond(
    clouds: tuple[str, ...],
    model: str | None,
    time: float | None,
    top: int | None,
    unit: str,
    viewpoint: str | None,
    stimuli: bool,
    as_json: bool,
    store: str | None,
) -> None:
    """Answers clouds with the concepts they resemble.

    Each cloud is that of one object, as a depth camera saw it. CLOUD is a PCD, PLY, XYZ, NPY or NPZ file, or - for
    standard input. Concepts are listed best first; with --json, one line a cloud. A cloud that cannot be answered
    does not keep the others from it, but the exit code is 1 at the end.
    """
    from service.application import CloudFile, parse_viewpoint
    from service.clouds import UNITS

    if unit not in UNITS:
        raise click.BadParameter(f"'{unit}' is none of {', '.join(UNITS)}.", param_hint="--unit")
    try:
        pose = parse_viewpoint(viewpoint) if viewpoint else None
    except InvalidParameter as error:
        raise click.BadParameter(str(error), param_hint="--viewpoint") from error
    application = _application(store)
    name, version = application.prepare(model)
    failed = 0
    for number, file in enumerate(clouds):
        try:
            with watched(file, number, len(clouds)) as on_stage:
                answer = application.respond(
                    CloudFile(_read(file), None, file, unit, pose),
                    model=name,
                    version=version,
                    time=time,
                    top=top,
                    stimuli=stimuli,
                    on_stage=on_stage,
                )
        except Exception as error:
            failed += 1
            _report(file, error, as_json)
            continue
        if as_json:
            click.echo(json.dumps({"file": file} | answer.model_dump()))
        else:
            from service import tables

            tables.show_answer(file, answer)
    if failed:
        sys.exit(1)


@main.group()
def models() -> None:
    """Lists, shows and promotes models."""


@models.command("list", epilog=_epilog("models list", "models list --store s3://robots/models --json"))
@json_option
@store_option
def list_models(as_json: bool, store: str | None) -> None:
    """Lists models, versions and aliases."""
    found = _application(store).models()
    if as_json:
        click.echo(json.dumps({"models": [summary.model_dump() for summary in found]}))
    else:
        from service import tables

        tables.show_models(found)


@models.command(epilog=_epilog("models show default", "models show default:1 --json"))
@click.argument("model", metavar="NAME")
@json_option
@store_option
def show(model: str, as_json: bool, store: str | None) -> None:
    """Shows how a model was made, and what its aliases have meant."""
    application = _application(store)
    name, version = application.which(model)
    manifest = application.manifest(name, version)
    history = application.alias_histories(name)
    if as_json:
        aliases = {alias: [entry._asdict() for entry in entries] for alias, entries in history.items()}
        click.echo(json.dumps(manifest.model_dump(mode="json") | {"aliases": aliases}))
    else:
        from service import tables

        tables.show_manifest(manifest, history)


@models.command(epilog=_epilog("models export default --out exported", "models export default:1 --out exported"))
@click.argument("model", metavar="NAME")
@click.option("--out", required=True, metavar="DIR", type=click.Path(path_type=Path, file_okay=False), help="Folder.")
@json_option
@store_option
def export(model: str, out: Path, as_json: bool, store: str | None) -> None:
    """Writes a model as files for any program.

    They are manifest.json and model.safetensors, byte for byte as the store has them.
    """
    application = _application(store)
    name, version = application.which(model)
    files = [str(path) for path in application.export(name, version, out)]
    result = {"model": name, "version": version, "files": files}
    _done(result, f"Wrote {name}:{version} to {' and '.join(files)}.", as_json)


@models.command(epilog=_epilog("models promote default:2", "models promote default:2 --alias staging"))
@click.argument("model", metavar="NAME:VERSION")
@click.option("--alias", default="production", show_default=True, help="Alias to move.")
@json_option
@store_option
def promote(model: str, alias: str, as_json: bool, store: str | None) -> None:
    """Lets an alias mean a version from now on."""
    name, version = _application(store).promote(model, alias)
    _done({"model": name, "version": version, "alias": alias}, f"{name}@{alias} is version {version} now.", as_json)


@models.command(epilog=_epilog("models rollback default", "models rollback default --alias staging"))
@click.argument("model", metavar="NAME")
@click.option("--alias", default="production", show_default=True, help="Alias to move back.")
@json_option
@store_option
def rollback(model: str, alias: str, as_json: bool, store: str | None) -> None:
    """Lets an alias mean what it meant before its last promotion."""
    version = _application(store).rollback(model, alias)
    _done({"model": model, "version": version, "alias": alias}, f"{model}@{alias} is version {version} again.", as_json)


@main.group()
def jobs() -> None:
    """Submits training jobs and tells what became of them.

    Workers (shape-concepts-worker run) take jobs from the database SHAPE_CONCEPTS_JOBS_URL, in the order in which
    they were submitted, and publish to their own model store.
    """


@jobs.command(
    epilog=_epilog(
        "jobs submit --simulate 250 --name default",
        "jobs submit --clouds scans --name workshop --alias staging --json",
        "jobs submit --simulate 1000 --name default --id nightly-2025-01-31",
    )
)
@click.option("--name", required=True, help="Of the model: lower-case letters, digits and hyphens.")
@click.option("--alias", default="production", show_default=True, help="What shall mean the new version.")
@click.option("--simulate", type=int, metavar="COUNT", help="Learn from simulated objects.")
@click.option(
    "--clouds",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Learn from all clouds of a folder that workers see.",
)
@click.option("--seed", type=int, default=7, show_default=True, help="Of all random draws.")
@click.option("--preset", default="default", show_default=True, help="Parameters of all stages: default or paper.")
@click.option("--renderer", type=click.Choice(["sapien", "raycast"]), help="What sees the scene.  [default: sapien]")
@click.option("--id", "job_id", metavar="ID", help="Names the job: submitted twice, it is one job.  [default: random]")
@json_option
def submit(
    name: str,
    alias: str,
    simulate: int | None,
    clouds: Path | None,
    seed: int,
    preset: str,
    renderer: str | None,
    job_id: str | None,
    as_json: bool,
) -> None:
    """Puts a training job into the queue."""
    from service.engine.params import ModelParams
    from service.jobs import JobSpec

    spec = JobSpec.of(
        name=name,
        alias=alias,
        simulate=simulate,
        clouds=str(clouds.absolute()) if clouds else None,
        seed=seed,
        params=ModelParams.preset(preset),
        simulation={"renderer": renderer} if renderer else {},
    )
    job = _application(None).submit(spec, job_id)
    _done(job.model_dump(mode="json"), f"Job {job.id} is {job.state}.", as_json)


@jobs.command("list", epilog=_epilog("jobs list", "jobs list --limit 100 --json"))
@click.option("--limit", type=click.IntRange(min=1), default=20, show_default=True, help="How many.")
@json_option
def list_jobs(limit: int, as_json: bool) -> None:
    """Lists jobs, the one submitted last first."""
    found = _application(None).jobs(limit)
    if as_json:
        click.echo(json.dumps({"jobs": [job.model_dump(mode="json") for job in found]}))
    else:
        from service import tables

        tables.show_jobs(found)


@jobs.command("show", epilog=_epilog("jobs show nightly-2025-01-31", "jobs show nightly-2025-01-31 --json"))
@click.argument("job", metavar="ID")
@json_option
def show_job(job: str, as_json: bool) -> None:
    """Shows a job: its state, what it is to do, and what came of it."""
    found = _application(None).job(job)
    if as_json:
        click.echo(found.model_dump_json())
    else:
        from service import tables

        tables.show_job(found)


@jobs.command(epilog=_epilog("jobs cancel nightly-2025-01-31"))
@click.argument("job", metavar="ID")
@json_option
def cancel(job: str, as_json: bool) -> None:
    """Takes a job from the queue, or stops it; one that is over stays as it is."""
    found = _application(None).cancel(job)
    _done(found.model_dump(mode="json"), f"Job {found.id} is {found.state}.", as_json)


@main.command(epilog=_epilog("serve", "serve --port 9000 --store s3://robots/models", "serve --host 0.0.0.0"))
@click.option("--host", help="Address to listen on; 0.0.0.0 for all.  [default: SHAPE_CONCEPTS_HOST, or 127.0.0.1]")
@click.option("--port", type=click.IntRange(0, 65535), help="TCP port.  [default: SHAPE_CONCEPTS_PORT, or 8000]")
@store_option
def serve(host: str | None, port: int | None, store: str | None) -> None:
    """Serves the REST interface.

    It ends at SIGTERM or Ctrl-C, when the requests under way are answered. /docs in a browser describes it.
    """
    from service.main import serve

    serve(settings_of(host=host, port=port, store=store))


def settings_of(**given: Any) -> Settings:
    """Settings of the environment, with what was given on the command line in their stead."""
    from pydantic import ValidationError

    from service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        faults = [f"SHAPE_CONCEPTS_{'_'.join(map(str, e['loc'])).upper()}: {e['msg']}" for e in error.errors()]
        raise click.UsageError("; ".join(faults)) from error


def _application(store: str | None) -> Application:
    from service.application import Application

    settings = settings_of(store=store)
    click.get_current_context().find_root().obj = settings.store
    return Application(settings)


def _read(file: str) -> bytes:
    """The bytes of a cloud's file."""
    try:
        return sys.stdin.buffer.read() if file == "-" else Path(file).read_bytes()
    except (OSError, ValueError) as error:
        raise UnreadableCloud(f"The file cannot be read: {getattr(error, 'strerror', None) or error}.") from error


def _report(file: str, error: Exception, as_json: bool) -> None:
    """Says why a cloud was not answered; a fault of ours also goes to the log, whole."""
    if isinstance(error, ShapeConceptsError):
        kind, detail = error.type_name(), str(error)
    else:
        kind, detail = "internal", f"Something unexpected went wrong: {type(error).__name__}."
        logging.getLogger(__name__).error("%s: unexpected", file, exc_info=error)
    if as_json:
        click.echo(json.dumps({"file": file, "error": {"type": kind, "detail": detail}}))
    else:
        click.echo(f"Error: {file}: {detail}", err=True)


def _done(result: dict[str, Any], sentence: str, as_json: bool) -> None:
    click.echo(json.dumps(result) if as_json else sentence)


if __name__ == "__main__":
    main()
