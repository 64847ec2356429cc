"""Reads a Dockerfile and its .dockerignore, as far as ours go, for the tests and for `prove.py`."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

KNOWN = {"FROM", "RUN", "COPY", "ENV", "USER", "WORKDIR", "LABEL", "VOLUME", "EXPOSE", "STOPSIGNAL"} | {
    "HEALTHCHECK",
    "ENTRYPOINT",
    "CMD",
}


class Step(NamedTuple):
    """An instruction of a Dockerfile: its word in capitals, and what follows it with the line ends taken out."""

    word: str
    rest: str


class Copy(NamedTuple):
    """What a COPY says: `--from`'s stage or None for the build's context, the sources, the destination."""

    stage: str | None
    sources: tuple[str, ...]
    target: str


class Stage(NamedTuple):
    """A stage: the image or stage that it begins from, its name, if it has one, and its steps."""

    base: str
    name: str | None
    steps: tuple[Step, ...]

    def said(self, word: str) -> list[str]:
        """What follows each instruction of that word."""
        return [step.rest for step in self.steps if step.word == word]

    def environment(self) -> dict[str, str]:
        """The variables that it sets."""
        return {name: value for text in self.said("ENV") for name, value in variables(text).items()}

    def command(self) -> list[str]:
        """What a container runs: ENTRYPOINT and CMD."""
        return [*json.loads(self.said("ENTRYPOINT")[-1]), *json.loads(self.said("CMD")[-1])]

    def health(self) -> list[str]:
        """The command of HEALTHCHECK."""
        found: list[str] = json.loads(self.said("HEALTHCHECK")[-1].partition("CMD")[2])
        return found


def read(file: Path) -> list[Stage]:
    """The stages of a Dockerfile, in order; the last one is the image.

    Raises:
        ValueError: it has an instruction that is not known here.
    """
    stages: list[Stage] = []
    steps: list[Step] = []
    for step in _steps(file.read_text()):
        if step.word not in KNOWN:
            raise ValueError(f"{file}: {step.word} is not understood")
        if step.word == "FROM":
            base, _, name = step.rest.partition(" AS ")
            steps = []
            stages.append(Stage(base, name or None, ()))
        else:
            steps.append(step)
            stages[-1] = stages[-1]._replace(steps=tuple(steps))
    return stages


def _steps(text: str) -> Iterator[Step]:
    lines = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))
    for line in re.sub(r"\\\n", " ", lines).splitlines():
        if line.strip():
            word, _, rest = line.strip().partition(" ")
            yield Step(word.upper(), " ".join(rest.split()) if word != "RUN" else rest.strip())


def variables(text: str) -> dict[str, str]:
    """The variables of an ENV or LABEL."""
    return {name: value for name, _, value in (word.partition("=") for word in shlex.split(text))}


def copied(text: str) -> Copy:
    """What a COPY says.

    Raises:
        ValueError: it has an option that is not known here.
    """
    words = shlex.split(text)
    options = [word for word in words if word.startswith("--")]
    stages = [option.removeprefix("--from=") for option in options if option.startswith("--from=")]
    if len(stages) != len(options):
        raise ValueError(f"COPY {text}: only --from is understood")
    *sources, target = [word for word in words if not word.startswith("--")]
    return Copy(stages[0] if stages else None, tuple(sources), target)


def context(paths: Iterable[str], ignore: str) -> list[str]:
    """Those of the repository's paths that a build sees: the last line of the .dockerignore that matches decides."""
    rules = [
        (not line.startswith("!"), _pattern(line.lstrip("!")))
        for line in ignore.splitlines()
        if line.strip() and not line.startswith("#")
    ]
    seen = []
    for path in paths:
        left_out = False
        for leaves_out, pattern in rules:
            if pattern.match(path):
                left_out = leaves_out
        if not left_out:
            seen.append(path)
    return seen


def _pattern(line: str) -> re.Pattern[str]:
    """What matches a path, or a folder that it is in."""
    parts = [
        "(?:.*/)?" if part == "**/" else "[^/]*" if part == "*" else re.escape(part)
        for part in re.split(r"(\*\*/|\*)", line.strip().strip("/"))
    ]
    return re.compile("".join(parts) + "(?:/|$)")
