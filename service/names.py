"""Names that people give to concepts: data beside the immutable model, shared by all replicas.

A name belongs to one version of a model: a concept is a node of that version's merge tree, and another version has
another tree. The names of a version are an append-only log, as an alias is; each entry also holds all names that
there are after it, so that a replica reads the last one only. A name that an earlier version's concept had may be
carried over to a concept that nobody has named yet; it says so until a person names the concept.
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from service.engine.errors import InvalidParameter, ModelDamaged
from service.objects import Objects

LONGEST = 100  # characters
_HARMFUL = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")  # control, direction, lone surrogates, private, line breaks
_JOINERS = "\u200c\u200d"  # without which some scripts cannot be written


class NameEntry(NamedTuple):
    """One line of the history of a concept's name.

    Attributes:
        name: what the concept is called from then on; None for nothing.
        at: UTC, ISO 8601.
        carried_from: NAME:VERSION whose concept had the name; None where a person gave it.
    """

    name: str | None
    at: str
    carried_from: str | None = None


class Names(NamedTuple):
    """The names of one version's concepts.

    Attributes:
        changes: how often they were changed; it only grows.
        of: the names by concept.
        carried: NAME:VERSION from which a name was carried over, by concept; the other names a person gave.
    """

    changes: int
    of: Mapping[int, str]
    carried: Mapping[int, str] = {}


NO_NAMES = Names(0, {})


class NameLog:
    """The names of one version, in a folder of a store."""

    def __init__(self, objects: Objects, folder: str) -> None:
        self._objects = objects
        self._folder = folder

    def read(self, known: Names = NO_NAMES) -> Names:
        """The names as they are now.

        Args:
            known: what was read before; only what came later is asked for.

        Raises:
            ModelDamaged: an entry was cut off or altered.
        """
        last = max(self._objects.numbers(self._folder, after=known.changes), default=known.changes)
        if last == known.changes:
            return known
        entry = self._entry(last)
        return Names(last, _by_concept(entry["names"]), _by_concept(entry.get("carried", {})))

    def history(self, concept: int) -> list[NameEntry]:
        """All that a concept was called, oldest first.

        Raises:
            ModelDamaged: an entry was cut off or altered.
        """
        entries = [self._entry(number) for number in self._objects.numbers(self._folder)]
        key = str(concept)
        return [
            NameEntry(entry["changed"][key], entry["at"], entry.get("from"))
            for entry in entries
            if key in entry["changed"]
        ]

    def change(self, changed: Mapping[int, str | None]) -> Names:
        """Names concepts, or takes their names away where None; nothing is appended if nothing changes.

        Args:
            changed: names by concept, as `check_concept_name` returned them. A name that was carried over is a
                person's, once it is given again.

        Returns:
            The names after it.
        """
        while True:
            held = self.read()
            new = {
                concept: name
                for concept, name in changed.items()
                if held.of.get(concept) != name or concept in held.carried
            }
            carried = {concept: source for concept, source in held.carried.items() if concept not in new}
            if (names := self._append(held, new, carried, None)) is not None:
                return names

    def carry(self, names: Mapping[int, str], source: str) -> Names:
        """Names concepts as an earlier version had it, but none that was ever named here, or whose name was taken away.

        Args:
            names: by concept.
            source: NAME:VERSION of the earlier version.

        Returns:
            The names after it.
        """
        while True:
            held = self.read()
            entries = [self._entry(number) for number in range(1, held.changes + 1)]
            touched = {int(concept) for entry in entries for concept in entry["changed"]}
            new = {concept: name for concept, name in names.items() if concept not in touched}
            carried = {**held.carried, **dict.fromkeys(new, source)}
            if (kept := self._append(held, new, carried, source)) is not None:
                return kept

    def _append(
        self, held: Names, new: Mapping[int, str | None], carried: Mapping[int, str], source: str | None
    ) -> Names | None:
        """The names after a change of what was held; None if another change came before."""
        if not new:
            return held
        names = {concept: name for concept, name in ({**held.of, **new}).items() if name is not None}
        at = datetime.now(UTC).isoformat(timespec="seconds")
        entry: dict[str, Any] = {"changed": new, "at": at, "names": names}
        if carried:
            entry["carried"] = carried
        if source is not None:
            entry["from"] = source
        line = json.dumps(entry, ensure_ascii=False, sort_keys=True) + "\n"
        if self._objects.create_number(self._folder, held.changes + 1, line.encode()):
            return Names(held.changes + 1, names, carried)
        return None

    def _entry(self, number: int) -> dict[str, Any]:
        try:
            entry = json.loads(self._objects.get_number(self._folder, number))
            _by_concept(entry["names"]), dict(entry["changed"]), str(entry["at"]), _by_concept(entry.get("carried", {}))
        except (ValueError, KeyError, TypeError, AttributeError, FileNotFoundError) as error:
            raise ModelDamaged(
                f"Entry {number} of the names {self._folder} was removed, cut off or altered."
            ) from error
        return dict(entry)


def _by_concept(stored: dict[str, Any]) -> dict[int, str]:
    return {int(concept): str(text) for concept, text in stored.items()}


def check_concept_name(name: str) -> str:
    """A name as it is kept: without blanks around it, in Unicode's composed form.

    Raises:
        InvalidParameter: it is empty, too long, or has characters that are not seen or break the line.
    """
    kept = unicodedata.normalize("NFC", name.strip())
    if not 1 <= len(kept) <= LONGEST:
        raise InvalidParameter(f"The name of a concept has 1 to {LONGEST} characters; this one has {len(kept)}.")
    for letter in kept:
        if unicodedata.category(letter) in _HARMFUL and letter not in _JOINERS:
            raise InvalidParameter(
                f"The name of a concept has visible characters only; this one has U+{ord(letter):04X}."
            )
    return kept
