"""`shape-concepts watch`: the answers to robots' streams, as they are published."""

from __future__ import annotations

import json
import queue
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from service.commands.options import json_option, settings_of
from service.commands.reporting import examples

if TYPE_CHECKING:
    from service.stream_table import Heard

WAITING = 1000  # answers kept for a terminal that is slow to show them
TICK = 0.2  # seconds after which Ctrl-C is noticed at the latest


@click.command(
    epilog=examples(
        "shape-concepts watch 'robots/*/cloud/concepts' --connect tcp/127.0.0.1:7447",
        "shape-concepts watch '**/concepts' --json",
    )
)
@click.argument("key", metavar="KEY")
@click.option(
    "--connect",
    metavar="ENDPOINT",
    help="zenoh router or peer to ask, such as tcp/HOST:7447.  [default: SHAPE_CONCEPTS_ZENOH_CONNECT]",
)
@click.option("--count", type=click.IntRange(min=1), help="End after so many answers.  [default: at Ctrl-C]")
@json_option
def watch(key: str, connect: str | None, count: int | None, as_json: bool) -> None:
    """Shows a live stream of answers.

    KEY is the key that answers are published on, that of the clouds with /concepts appended; * stands for one part of
    it, ** for several. The table has a line for each robot. Latency is the time from a robot's publishing its cloud
    to the answer's arrival here, by their clocks. The settings SHAPE_CONCEPTS_ZENOH_... say how to get in; with
    --json, each answer is one line: {"key", "answer"}, or {"key", "error"} with the problem in its stead.
    """
    try:
        with _listening(key, connect) as heard:
            if as_json:
                for number, answer in enumerate(heard, start=1):
                    click.echo(
                        json.dumps({"key": answer.key, "error" if answer.problem else "answer": answer.document})
                    )
                    if number == count:
                        return
            else:
                _show(heard, count)
    except KeyboardInterrupt:
        pass


def _show(heard: Iterator[Heard], count: int | None) -> None:
    from rich.live import Live

    from service.stream_table import StreamTable

    table = StreamTable()
    with Live(table, refresh_per_second=8):
        for number, answer in enumerate(heard, start=1):
            table.add(answer)
            if number == count:
                return


@contextmanager
def _listening(key: str, connect: str | None) -> Iterator[Iterator[Heard]]:
    """Yields what comes, for ever; the session is closed at the end."""
    import zenoh
    from zenoh.handlers import Callback

    from service.engine.errors import InvalidParameter
    from service.stream_table import read
    from service.transports.zenoh.config import configuration, is_wanted

    settings = settings_of(zenoh_connect=connect)
    if not is_wanted(settings):
        raise click.UsageError("Say whom to ask: --connect tcp/HOST:7447, or SHAPE_CONCEPTS_ZENOH_CONNECT.")
    waiting: queue.Queue[Heard] = queue.Queue(WAITING)
    lost = 0

    def take(sample: zenoh.Sample) -> None:
        nonlocal lost
        try:
            payload = sample.payload.to_bytes()
            waiting.put_nowait(read(str(sample.key_expr), str(sample.encoding), payload, time.time_ns()))
        except queue.Full:
            lost += 1

    def heard() -> Iterator[Heard]:
        while True:
            try:
                yield waiting.get(timeout=TICK)
            except queue.Empty:
                continue

    try:
        with zenoh.open(configuration(settings)) as session:
            session.declare_subscriber(key, Callback(take, indirect=False))
            click.echo(f"listening to {key}", err=True)
            yield heard()
    except zenoh.ZError as error:
        raise InvalidParameter(f"zenoh: {str(error).partition(' at /')[0]}") from None
    finally:
        if lost:
            click.echo(f"{lost} answers came too fast to be shown", err=True)
