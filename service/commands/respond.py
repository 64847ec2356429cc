"""`shape-concepts respond`: clouds in, concepts out."""

from __future__ import annotations

import json
import logging
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.commands.options import application_of, json_option, store_option
from service.commands.reporting import examples, in_words
from service.engine.errors import InvalidParameter, ShapeConceptsError, UnreadableCloud
from service.progress import watched

if TYPE_CHECKING:
    from service.application import CloudFile

TOP = 10  # concepts that a table lists unless more are asked for: those of all scales fill several screens
COMPILING = "still at work: the first cloud after an installation takes up to half a minute, as the engine is compiled"


@click.command(
    epilog=examples(
        "shape-concepts respond mug.pcd",
        "shape-concepts respond --html mug.html mug.pcd",
        "shape-concepts respond --model default --top 3 --unit mm scans/*.ply",
        "shape-concepts respond --model default:2 --time 0.2 --json --stimuli mug.npy",
        "shape-concepts respond --viewpoint 0,-0.4,-0.9 --json - < mug.xyz",
        "shape-concepts respond --model default --explain --top 3 mug.pcd",
        "shape-concepts respond --model default --json --segments mug.pcd",
        "shape-concepts respond --intrinsics 525,525,319.5,239.5 --mask mask.png depth.png",
        "shape-concepts respond --model default --scene --top 3 table.pcd",
        "shape-concepts respond --save mug.rrd mug.pcd",
    )
)
@click.argument("clouds", nargs=-1, required=True, metavar="CLOUD...")
@click.option(
    "--model",
    metavar="NAME",
    help="Model to ask.  [default: SHAPE_CONCEPTS_MODEL, or the store's only one, or the built-in one]",
)
@click.option(
    "--time",
    type=click.FloatRange(0, 1),
    help="Filtration time of all concepts: 0 specific, 1 generic.  [default: epsilon_max, that of most annexations; "
    "then others]",
)
@click.option(
    "--top", type=click.IntRange(min=1), help=f"How many concepts to list.  [default: {TOP}; all with --json]"
)
@click.option("--unit", help="Unit of the coordinates: m, dm, cm, mm, um, in, ft.  [default: the file's own, or m]")
@click.option(
    "--viewpoint", metavar="POSE", help="Sensor pose in the cloud's frame and unit: x,y,z or x,y,z,qw,qx,qy,qz."
)
@click.option("--intrinsics", metavar="FX,FY,CX,CY", help="Camera of a depth image, pixels.")
@click.option(
    "--depth-scale",
    type=click.FloatRange(min=0, min_open=True),
    help="Metres that a depth of 1 stands for.  [default: 0.001 for whole numbers, 1 for floats]",
)
@click.option(
    "--mask",
    type=click.Path(exists=True, dir_okay=False),
    help="PNG or NPY of the depth image's size, not 0 where the object is.",
)
@click.option("--stimuli", is_flag=True, help="With --json: the stimuli vector as well.")
@click.option("--explain", is_flag=True, help="Say why: segments, motif vertices that fired, nearest prototypes.")
@click.option("--segments", is_flag=True, help="With --json: the segment of each point, -1 for none.")
@click.option("--scene", is_flag=True, help="The clouds are whole scenes: answer each object on a table or a floor.")
@click.option(
    "--html",
    metavar="FILE",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw the clouds and their answers into a page that needs no server and no network.",
)
@click.option(
    "--save",
    metavar="FILE.rrd",
    type=click.Path(dir_okay=False, path_type=Path),
    help="The same as a recording for Rerun's viewer (extra rerun).",
)
@json_option
@store_option
def respond(
    clouds: tuple[str, ...],
    model: str | None,
    time: float | None,
    top: int | None,
    unit: str | None,
    viewpoint: str | None,
    intrinsics: str | None,
    depth_scale: float | None,
    mask: str | None,
    stimuli: bool,
    explain: bool,
    segments: bool,
    scene: bool,
    html: Path | None,
    save: Path | None,
    as_json: bool,
    store: str | None,
) -> None:
    """Answers clouds with the concepts they resemble.

    Each cloud is that of one object, as a depth camera saw it; with --scene, of a table or a floor with the objects
    that stand on it. CLOUD is a PCD, PLY, XYZ, NPY, NPZ or JSON file, a PointCloud2 of ROS in CDR, a depth image (PNG
    or NPY) with --intrinsics, or - for standard input. Concepts are listed best first, those at epsilon_max before
    those of other times; with --json, one line a cloud. A cloud that cannot be answered does not keep the others from
    it, but the exit code is 1 at the end.
    """
    from service.scene_answer import SceneAnswer

    said = _said_of_clouds(unit, viewpoint, intrinsics, depth_scale)
    if mask and len(clouds) > 1:
        raise click.BadParameter("It belongs to one depth image; give one CLOUD.", param_hint="--mask")
    drawing = None
    if html or save:
        from service.commands.drawing import Drawing, as_asked

        drawing = Drawing(html, save, len(clouds))
    try:
        application = application_of(store)
        name, version = application.prepare(model)
        if store and application.models.one(name).built_in:
            click.echo(f"The store {store} holds no model: the one that comes with the service answers.", err=True)
    except ShapeConceptsError as error:
        if not as_json:
            raise
        for file in clouds:
            _report(file, error, as_json)
        sys.exit(1)
    ask = application.respond_scene if scene else application.respond
    failed = 0
    for number, file in enumerate(clouds):
        try:
            cloud = said._replace(data=_read(file), name=file, mask=_read(mask) if mask else None)
            with watched(file, number, len(clouds), excuse=COMPILING) as on_stage:
                answer = ask(
                    cloud,
                    model=name,
                    version=version,
                    time=time,
                    top=top or (None if as_json else TOP),
                    stimuli=stimuli,
                    explain=explain or drawing is not None,
                    segments=segments or drawing is not None,
                    on_stage=on_stage,
                )
            if drawing:
                drawing.add(application, cloud, answer)
                answer = as_asked(answer, explain=explain, segments=segments)
        except Exception as error:
            failed += 1
            _report(file, error, as_json)
            continue
        if as_json:
            click.echo(json.dumps({"file": file} | answer.model_dump()))
        else:
            from service import tables

            thumbnail = partial(application.looking.thumbnail, name, version)
            if isinstance(answer, SceneAnswer):
                tables.show_scene(file, answer, thumbnail)
            else:
                tables.show_answer(file, answer)
                if answer.explanation:
                    tables.show_explanation(answer.explanation, thumbnail)
    if drawing:
        drawing.write()
    if failed:
        sys.exit(1)


def _said_of_clouds(
    unit: str | None, viewpoint: str | None, intrinsics: str | None, depth_scale: float | None
) -> CloudFile:
    """What the options say of every cloud, as a cloud without bytes."""
    from service.application import CloudFile, parse_viewpoint
    from service.clouds import UNITS, parse_camera

    if unit is not None and unit not in UNITS:
        raise click.BadParameter(f"'{unit}' is none of {', '.join(UNITS)}.", param_hint="--unit")
    try:
        pose = parse_viewpoint(viewpoint) if viewpoint else None
    except InvalidParameter as error:
        raise click.BadParameter(str(error), param_hint="--viewpoint") from error
    try:
        camera = parse_camera(intrinsics, depth_scale)
    except InvalidParameter as error:
        raise click.BadParameter(str(error), param_hint="--intrinsics") from error
    return CloudFile(b"", unit=unit, viewpoint=pose, camera=camera)


def _read(file: str) -> bytes:
    """The bytes of a cloud's file."""
    try:
        return sys.stdin.buffer.read() if file == "-" else Path(file).read_bytes()
    except IsADirectoryError:
        raise UnreadableCloud(f"It is a folder; give the clouds in it, such as {Path(file) / '*.ply'}.") from None
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
        said = in_words(error) if isinstance(error, ShapeConceptsError) else detail
        click.echo(f"Error: {file}: {said}", err=True)
