"""Copies a store: `python copy_store.py FROM TO`, each a folder or s3://bucket/prefix. For backups, and back again.

The copy is sound whatever is published meanwhile, and so is a store that answers while it is restored. Things are
written in the order content, what names the content, aliases: so they are listed in the reverse order, and copied in
this one. Content that is there already is not copied again. Both stores need the same credentials, or be folders.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from service.engine.errors import ShapeConceptsError
from service.objects import Objects

CONTENT, NAMING, ALIASES = range(3)  # each may name what is of those before it


def rank(key: str) -> int:
    """When an object is written, among those that belong together."""
    folders = key.split("/")[:-1]
    return CONTENT if "blobs" in folders else ALIASES if "aliases" in folders else NAMING


def listed(source: Objects) -> list[str]:
    """Keys of the source in the order to copy them in: whatever one of them names is among those before it."""
    found: list[list[str]] = [
        [key for key in source.keys("") if rank(key) == wanted] for wanted in (ALIASES, NAMING, CONTENT)
    ]
    return [key for keys in reversed(found) for key in keys]


def copy(source: Objects, target: Objects) -> Iterator[str]:
    """Copies all objects; gives the key of each that was copied."""
    there = {key for key in target.keys("") if rank(key) == CONTENT}
    for key in listed(source):
        if key in there:
            continue
        try:
            data = source.get(key)
        except FileNotFoundError:  # removed meanwhile: a job's files when it is done, or a dataset
            continue
        target.put(key, data)
        yield key


def main() -> None:
    """Copies what the command line says."""
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        copied = sum(1 for _ in copy(Objects(sys.argv[1]), Objects(sys.argv[2])))
    except ShapeConceptsError as error:
        sys.exit(str(error))
    print(f"Copied {copied} objects.")


if __name__ == "__main__":
    main()
