"""Whether the addresses of `shape-concepts serve` are free, before anything is loaded."""

from __future__ import annotations

import errno
import socket

import click


def check_free(host: str, port: int, option: str) -> None:
    """Says which option to change where something else listens already; what is not known yet, the server says.

    Args:
        host: address to listen on.
        port: TCP port; 0 for any free one, and less for none.
        option: that chose the port.

    Raises:
        click.ClickException: the port is in use.
    """
    if port <= 0:
        return
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the servers do
            probe.bind(address)
            probe.listen(1)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            return
        raise click.ClickException(
            f"Port {port} of {host}: address already in use, perhaps by another shape-concepts serve. End that, or "
            f"give another one with {option}; 0 takes any free one."
        ) from None
