"""`shape-concepts datasets record`: a stream of zenoh becomes clouds to learn from."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from service.commands.options import json_option, settings_of, store_option
from service.commands.reporting import examples

if TYPE_CHECKING:
    from service.settings import Settings
    from service.streams import Stream
    from service.transports.zenoh.recording import Recorder


@click.command(
    epilog=examples(
        "shape-concepts datasets record mugs --key 'robots/*/cloud' --count 100 --connect tcp/127.0.0.1:7447",
        "shape-concepts datasets record mugs --key '0/**/sensor_msgs::msg::dds_::PointCloud2_/*' --frame body "
        "--seconds 60",
    )
)
@click.argument("name")
@click.option("--key", required=True, metavar="KEY", help="Key expression of the clouds; * and ** stand for parts.")
@click.option("--count", type=click.IntRange(min=1), help="End after so many clouds were added.  [default: at Ctrl-C]")
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="End after this time.  [default: at Ctrl-C]"
)
@click.option(
    "--connect",
    metavar="ENDPOINT",
    help="zenoh router or peer to ask, such as tcp/HOST:7447.  [default: SHAPE_CONCEPTS_ZENOH_CONNECT]",
)
@click.option("--format", help="Of the clouds.  [default: the key, the encoding or the content tells]")
@click.option("--unit", help="Unit of the coordinates: m, dm, cm, mm, um, in, ft.  [default: their own, or m]")
@click.option(
    "--frame",
    type=click.Choice(["optical", "body"]),
    default="optical",
    show_default=True,
    help="Axes: optical has x right, y down, z forward; body x forward, y left, z up.",
)
@click.option("--viewpoint", metavar="POSE", help="Sensor pose instead of a frame: x,y,z or x,y,z,qw,qx,qy,qz.")
@json_option
@store_option
def record(
    name: str,
    key: str,
    count: int | None,
    seconds: float | None,
    connect: str | None,
    format: str | None,
    unit: str | None,
    frame: str,
    viewpoint: str | None,
    as_json: bool,
    store: str | None,
) -> None:
    """Records a stream of zenoh into the dataset NAME.

    Clouds are kept as they come, ROS 2 messages as NPY, under their key and the time at which they came. The newest
    wins: of those that come while one is being added, the last of each key is added next, and the others are counted
    as dropped. With --json, each cloud is one line, and the last line sums up. The exit code is 1 if no cloud was
    added.
    """
    from service.application import Application
    from service.transports.zenoh.recording import Recorder

    settings = settings_of(store=store, zenoh_connect=connect)
    stream = _stream({"key": key, "format": format, "unit": unit, "frame": frame, "viewpoint": viewpoint})
    recorder = Recorder(Application(settings), name, stream)
    outcomes: dict[str, int] = {}
    try:
        with _listening(settings, stream, recorder):
            for verdict, dropped in recorder.record(seconds):
                outcomes[verdict.outcome] = outcomes.get(verdict.outcome, 0) + 1
                if as_json:
                    click.echo(json.dumps(verdict.model_dump() | {"dropped": dropped}))
                elif verdict.error:
                    click.echo(f"Error: {verdict.key}: {verdict.error.detail}", err=True)
                if count is not None and outcomes.get("accepted") == count:
                    break
    except KeyboardInterrupt:
        pass
    if as_json:
        click.echo(json.dumps({"dataset": name, "outcomes": outcomes, "dropped": recorder.dropped}))
    else:
        told = ", ".join(f"{number} {outcome}" for outcome, number in outcomes.items()) or "no cloud came"
        click.echo(f"{name}: {told}, {recorder.dropped} dropped")
    if not outcomes.get("accepted"):
        sys.exit(1)


def _stream(given: dict[str, str | None]) -> Stream:
    from pydantic import ValidationError

    from service.clouds import FORMATS, UNITS
    from service.streams import Stream

    for option, known in (("format", FORMATS), ("unit", UNITS)):
        if given[option] not in (None, *known):
            raise click.BadParameter(f"it is one of {', '.join(known)}.", param_hint=f"--{option}")
    try:
        return Stream.model_validate(given)
    except ValidationError as error:
        raise click.UsageError("; ".join(f"--{fault['loc'][0]}: {fault['msg']}" for fault in error.errors())) from None


@contextmanager
def _listening(settings: Settings, stream: Stream, recorder: Recorder) -> Iterator[None]:
    """Hands what comes to the recorder; the session is closed at the end."""
    import zenoh
    from zenoh.handlers import Callback

    from service.engine.errors import InvalidParameter
    from service.transports.zenoh.answering import key_of
    from service.transports.zenoh.config import configuration, is_wanted

    if not is_wanted(settings):
        raise click.UsageError("Say whom to ask: --connect tcp/HOST:7447, or SHAPE_CONCEPTS_ZENOH_CONNECT.")
    key = key_of(stream)
    try:
        with zenoh.open(configuration(settings)) as session:
            session.declare_subscriber(key, Callback(recorder.arrived, indirect=False))
            click.echo(f"listening to {stream.key}", err=True)
            yield
    except zenoh.ZError as error:
        raise InvalidParameter(f"zenoh: {str(error).partition(' at /')[0]}") from None
