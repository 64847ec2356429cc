"""The command line of the service: `shape-concepts`.

What a command needs is imported when it runs, so that `--help` answers at once. Results go to stdout, everything
else to stderr. Exit codes: 0 all went well, 1 something failed, 2 the command was not understood.
"""

from __future__ import annotations

import click

from service import __version__
from service.commands.datasets import datasets
from service.commands.jobs import jobs
from service.commands.keys import keys
from service.commands.models import models
from service.commands.names import names
from service.commands.options import settings_of, store_option
from service.commands.ports import check_free
from service.commands.reporting import ReportingGroup, examples
from service.commands.respond import respond
from service.commands.schedules import schedules
from service.commands.watch import watch


@click.group(
    cls=ReportingGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog=examples(
        "shape-concepts respond mug.pcd",
        "shape-concepts respond --html mug.html mug.pcd",
        "shape-concepts models list",
        "shape-concepts serve --port 8000",
    ),
)
@click.version_option(__version__, prog_name="shape-concepts")
def main() -> None:
    """Tells of an object's point cloud which learned shape concepts it resembles.

    Models are named NAME, NAME@ALIAS or NAME:VERSION; a bare NAME means NAME@production.
    """


@main.command(
    short_help="Serves REST, gRPC and zenoh, and the page.",
    epilog=examples(
        "shape-concepts serve",
        "shape-concepts serve --port 9000 --store s3://robots/models",
        "shape-concepts serve --host 0.0.0.0",
    ),
)
@click.option("--host", help="Address to listen on; 0.0.0.0 for all.  [default: SHAPE_CONCEPTS_HOST, or 127.0.0.1]")
@click.option("--port", type=click.IntRange(0, 65535), help="TCP port.  [default: SHAPE_CONCEPTS_PORT, or 8000]")
@click.option(
    "--grpc-port",
    type=click.IntRange(-1, 65535),
    help="TCP port of gRPC; -1 for no gRPC.  [default: SHAPE_CONCEPTS_GRPC_PORT, or 8001]",
)
@store_option
def serve(host: str | None, port: int | None, grpc_port: int | None, store: str | None) -> None:
    """Serves the REST and gRPC interfaces, and answers over zenoh where that is configured.

    It ends at SIGTERM or Ctrl-C, when the requests under way are answered. In a browser, / is a page to try clouds and
    to look at concepts, and /docs describes REST; gRPC describes itself by reflection.
    """
    settings = settings_of(host=host, port=port, grpc_port=grpc_port, store=store)
    for option, chosen in (("--port", settings.port), ("--grpc-port", settings.grpc_port)):
        check_free(settings.host, chosen, option)

    from service.main import serve

    serve(settings)


for command in (respond, models, names, datasets, jobs, schedules, keys, watch):
    main.add_command(command)

if __name__ == "__main__":
    main()
