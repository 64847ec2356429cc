"""What names a request in answers, problems and the log."""

from __future__ import annotations

import random
import re
import uuid

_ACCEPTED = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")  # harmless in a header, a line of a log and a URN


def name_request(given: str) -> str:
    """The id that a client gave its request, if it is harmless; else a new one."""
    return given if _ACCEPTED.fullmatch(given) else new_id()


def new_id() -> str:
    """A random UUID. It names and guards nothing, so that it need not be asked of the system, which takes longer."""
    return str(uuid.UUID(int=random.getrandbits(128), version=4))
