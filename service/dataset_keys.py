"""Keys of clouds: paths as people write them, and as the store can hold them whatever it is.

An object's path may hold letters, digits, `.`, `-` and `_` in a folder as in any bucket; every other byte of a key is
written `=XX`. What has `=.json` appended is no folder of any other key, so a key may be another one's beginning.
"""

from __future__ import annotations

import re

from service.clouds.claims import quote
from service.engine.errors import InvalidParameter
from service.labels import FILE as LABELS

LONGEST = 240  # bytes of a part as the store has it: file systems take 255
LONGEST_KEY = 600  # bytes of the whole: buckets take 1024
END = "=.json"
_PLAIN = re.compile(rb"[A-Za-z0-9._-]")


def check_key(key: str) -> str:
    """Refuses what no cloud can be called; returns the key.

    Raises:
        InvalidParameter: it is no relative path of visible characters, or reaches out of its folder.
    """
    parts = key.split("/")
    if not key.isprintable() or "\\" in key or any(part in ("", ".", "..") or part != part.strip() for part in parts):
        raise InvalidParameter(
            f"A cloud cannot be called {quote(key)}: its key is a relative path of visible characters, such as "
            "kitchen/mug-7.ply, without empty parts, . and .. or backslashes."
        )
    if parts[-1] == LABELS:
        raise InvalidParameter(f"{LABELS} is no cloud: it is what holds the labels of clouds.")
    if max(map(len, map(_written, parts))) > LONGEST or len(path_of(key)) > LONGEST_KEY:
        raise InvalidParameter(
            f"The key {quote(key)} is too long: at most {LONGEST} letters a part and {LONGEST_KEY} in all, others than "
            "those of English counting several times."
        )
    return key


def path_of(key: str) -> str:
    """Where the store has the object of a key."""
    return "/".join(map(_written, key.split("/"))) + END


def key_of(path: str) -> str | None:
    """The key whose object is there; None if that is none."""
    if not path.endswith(END):
        return None
    octets = re.sub(rb"=([0-9A-F]{2})", lambda found: bytes.fromhex(found[1].decode()), path[: -len(END)].encode())
    return octets.decode(errors="replace")


def _written(part: str) -> str:
    octets = part.encode("utf-8", "surrogatepass")
    return "".join(chr(o) if _PLAIN.match(bytes([o])) else f"={o:02X}" for o in octets)
