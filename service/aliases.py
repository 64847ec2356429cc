"""The history of an alias: an append-only log of objects, whose last entry holds.

A log, because a folder offers no compare-and-swap: two writers who append at the same time both want the next
number, and of a put that creates or fails only one succeeds. The history and rolling back come for free.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple

from service.engine.errors import ModelDamaged
from service.objects import Objects


class AliasEntry(NamedTuple):
    """One line of an alias's history.

    Attributes:
        version: what the alias means from then on.
        action: "promote" or "rollback".
        at: UTC, ISO 8601.
    """

    version: int
    action: str
    at: str


class AliasLog:
    """The log of one alias, in a folder of a store."""

    def __init__(self, objects: Objects, folder: str) -> None:
        self._objects = objects
        self._folder = folder

    def history(self) -> list[AliasEntry]:
        """All entries, oldest first.

        Raises:
            ModelDamaged: one was cut off or altered.
        """
        return [self._entry(number) for number in self._objects.numbers(self._folder)]

    def current(self) -> int | None:
        """The version that the alias means, None if there is no such alias."""
        numbers = self._objects.numbers(self._folder)
        return self._entry(numbers[-1]).version if numbers else None

    def promote(self, version: int, *, only_forward: bool = False) -> None:
        """Lets the alias mean a version; nothing is appended when it does already.

        Args:
            version: the version.
            only_forward: leaves an alias alone that means a later version.
        """

        def entry(held: list[int]) -> tuple[int, str] | None:
            if held[-1:] == [version] or (only_forward and held[-1:] > [version]):
                return None
            return version, "promote"

        self._append(entry)

    def exchange(self, before: int | None, version: int) -> bool:
        """Lets the alias mean a version if it means another one still; returns whether it means the version then.

        Args:
            before: what the alias has to mean; None for nothing.
            version: what it shall mean.
        """

        def entry(held: list[int]) -> tuple[int, str] | None:
            means = held[-1] if held else None
            return (version, "promote") if means == before and means != version else None

        return self._append(entry) is not None or self.current() == version

    def rollback(self, leaving: int | None = None) -> int | None:
        """Lets the alias mean what it meant before its last promotion, and again, before the one before.

        Args:
            leaving: the version that it has to mean now; None for any.

        Returns:
            The version that it means now; None, and nothing changes, if there is none to go back to.
        """

        def entry(held: list[int]) -> tuple[int, str] | None:
            if len(held) < 2 or leaving not in (None, held[-1]):
                return None
            return held[-2], "rollback"

        return self._append(entry)

    def _append(self, entry: Callable[[list[int]], tuple[int, str] | None]) -> int | None:
        """Appends what `entry` makes of the versions held so far, anew if somebody else was quicker."""
        while True:
            last = max(self._objects.numbers(self._folder), default=0)
            if (chosen := entry(_held(self.history()))) is None:
                return None
            at = datetime.now(UTC).isoformat(timespec="seconds")
            line = json.dumps(AliasEntry(*chosen, at)._asdict()) + "\n"
            if self._objects.create_number(self._folder, last + 1, line.encode()):
                return chosen[0]

    def _entry(self, number: int) -> AliasEntry:
        try:
            line = json.loads(self._objects.get_number(self._folder, number))
            return AliasEntry(int(line["version"]), str(line["action"]), str(line["at"]))
        except (ValueError, KeyError, TypeError, FileNotFoundError) as error:
            raise ModelDamaged(
                f"Entry {number} of the alias {self._folder} was removed, cut off or altered."
            ) from error


def _held(history: list[AliasEntry]) -> list[int]:
    """The versions to which rolling back would lead, the current one last: a promotion adds, a rollback removes."""
    held: list[int] = []
    for entry in history:
        if entry.action != "rollback":
            held.append(entry.version)
        elif len(held) > 1:
            held.pop()
    return held
