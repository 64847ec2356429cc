"""The model store: immutable versions and aliases with history, in a folder or a bucket.

Layout, below the store's URL:

    blobs/sha256/<hex>.safetensors                 tensors, by content
    models/<name>/versions/<8 digits>.json         manifests; a version exists when its manifest does
    models/<name>/aliases/<alias>/<8 digits>.json  an append-only log; the highest number holds
    models/<name>/names/<version>/<8 digits>.json  another one: the names of the version's concepts
    models/<name>/once/<key>/<8 digits>.json       numbers that a publication which may be repeated has chosen

Content is written first and the manifest last, with a put that creates or fails: a version is there whole or not at
all, and of two publishers who want the same number one takes the next.
"""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from service.aliases import AliasEntry, AliasLog
from service.engine.errors import InvalidParameter, ModelDamaged, ModelNotFound
from service.engine.model import ShapeModel
from service.model_file import (
    NAME,
    TENSORS,
    Manifest,
    check_name,
    decode,
    describe,
    encode,
    read_manifest,
    sha256,
    write_manifest,
)
from service.names import NameLog
from service.objects import Objects

PRODUCTION = "production"
SHIPPED = Path(__file__).with_name("default_model")  # the store of the model that comes with the service
NO_MODEL = (
    "The store holds no model yet: train and publish one first, "
    "with shape-concepts-worker train --simulate 250 --name default"
)
REFERENCE = re.compile(rf"(?P<name>{NAME})(@(?P<alias>{NAME})|:(?P<version>[0-9]{{1,8}}))?")


class _Choice(NamedTuple):
    """The number and the time under which a publication wants to appear, at its so-manieth attempt."""

    attempt: int
    version: int
    created: datetime


class ModelStore:
    """Models by name and version, in the folder or bucket of a URL."""

    def __init__(self, url: str | Path) -> None:
        self._objects = Objects(url)
        self.url = self._objects.url

    # Writing

    def publish(
        self,
        model: ShapeModel,
        *,
        name: str,
        seed: int,
        source: dict[str, Any],
        alias: str | None = PRODUCTION,
        parent: str | None = None,
        metrics: dict[str, float] | None = None,
        job: str | None = None,
        once: str | None = None,
    ) -> Manifest:
        """Publishes a model as the next version of a name, and lets an alias mean it.

        The versions of the model that ships with the service are never given again, though this store has none of them:
        `default:1` means one model wherever it is asked.

        Args:
            model: what to publish.
            name: of the model, `[a-z0-9][a-z0-9-]*`.
            seed: of the training.
            source: where the training clouds came from, JSON-able.
            alias: of the new version; None for none.
            parent: NAME:VERSION of the model that it follows.
            metrics: figures by which it was judged.
            job: id of the job that made it.
            once: however often, and by however many, a job publishes with the same key, it is one version.

        Raises:
            InvalidParameter: the name or alias is not of that form.
            StoreUnavailable: the store cannot be written.
        """
        check_name(name, " model")
        if alias is not None:
            check_name(alias, "n alias")
        self._objects.sweep()
        data = encode(model)
        self._objects.put(_blob_key(sha256(data)), data)
        made: dict[str, Any] = {"name": name, "seed": seed, "source": source}
        made |= {"parent": parent, "metrics": metrics, "job": job}
        place = f"models/{name}/once/{once}" if once else None
        choice = self._chosen(name, place)
        while True:
            manifest = describe(model, data, version=choice.version, created=choice.created, **made)
            if self._objects.create_number(_versions(name), choice.version, write_manifest(manifest)):
                break
            there = self.manifest(name, choice.version) if place else None
            if there and (there.created, there.job) == (choice.created, job):  # it was us, before
                manifest = there
                break
            choice = self._chosen(name, place, choice)
        if alias is not None:  # unless a racer has let it mean a later version meanwhile
            self._log(name, alias).promote(choice.version, only_forward=True)
        return manifest

    def promote(self, name: str, version: int, alias: str = PRODUCTION, *, only_forward: bool = False) -> None:
        """Lets an alias mean a version from now on; nothing happens when it does already.

        Args:
            name: of the model.
            version: of the model.
            alias: to move.
            only_forward: whether nothing happens either when it means a later version.

        Raises:
            ModelNotFound: there is no such version.
        """
        check_name(alias, "n alias")
        self._require(name, version)
        self._log(name, alias).promote(version, only_forward=only_forward)

    def exchange(self, name: str, before: int | None, version: int, alias: str = PRODUCTION) -> bool:
        """Lets an alias mean a version if it means another one still; returns whether it means the version then.

        Args:
            name: of the model.
            before: the version that the alias has to mean; None for none.
            version: that it shall mean.
            alias: to move.

        Raises:
            ModelNotFound: there is no such version.
        """
        check_name(alias, "n alias")
        self._require(name, version)
        return self._log(name, alias).exchange(before, version)

    def rollback(self, name: str, alias: str = PRODUCTION, leaving: int | None = None) -> int:
        """Lets an alias mean what it meant before its last promotion; again, the one before that.

        Args:
            name: of the model.
            alias: of its version.
            leaving: the version that it shall no longer mean; if it does not, nothing happens. Repeated with the same
                one, it is done once.

        Returns:
            The version that the alias means now.

        Raises:
            ModelNotFound: there is no such alias.
            InvalidParameter: there is no earlier version to go back to.
        """
        if (version := self._log(name, alias).rollback(leaving)) is not None:
            return version
        if (current := self._log(name, alias).current()) is None:
            raise self._no_alias(name, alias)
        if leaving is not None and current != leaving:
            return current
        raise InvalidParameter(f"{name}@{alias} means version {current} and nothing before: it cannot be rolled back.")

    # Reading

    def names(self) -> list[str]:
        """Names of all models, sorted."""
        return [name for name in self._objects.folders("models") if self.versions(name)]

    def versions(self, name: str) -> list[int]:
        """Versions of a model, ascending; none when there is no such model."""
        return self._objects.numbers(_versions(name))

    def require(self, name: str) -> list[int]:
        """Versions of a model, ascending.

        Raises:
            ModelNotFound: there is no such model.
        """
        if versions := self.versions(name):
            return versions
        raise ModelNotFound(f"There is no model '{name}'. {self._what_exists(name)}")

    def aliases(self, name: str) -> dict[str, int]:
        """What each alias of a model means."""
        aliases = {alias: self._log(name, alias).current() for alias in self._objects.folders(f"models/{name}/aliases")}
        return {alias: version for alias, version in aliases.items() if version is not None}

    def alias_history(self, name: str, alias: str = PRODUCTION) -> list[AliasEntry]:
        """All that an alias has meant, oldest first; nothing when there is no such alias."""
        return self._log(name, alias).history()

    def concept_names(self, name: str, version: int) -> NameLog:
        """The names of a version's concepts."""
        return NameLog(self._objects, f"models/{name}/names/{version:08}")

    def resolve(self, reference: str) -> tuple[str, int]:
        """Name and version of `NAME`, which means `NAME@production`, `NAME@ALIAS` or `NAME:VERSION`.

        Raises:
            InvalidParameter: the reference has another form.
            ModelNotFound: there is no such model, version or alias; the message says which there are.
        """
        match = REFERENCE.fullmatch(reference)
        if match is None:
            raise InvalidParameter(
                f"'{reference}' names no model: write NAME, NAME@ALIAS or NAME:VERSION, names in lower-case letters, "
                "digits and hyphens."
            )
        name = match["name"]
        if match["version"]:
            self._require(name, int(match["version"]))
            return name, int(match["version"])
        alias = match["alias"] or PRODUCTION
        if (version := self._log(name, alias).current()) is None:
            raise self._no_alias(name, alias)
        return name, version

    def manifest(self, name: str, version: int) -> Manifest:
        """The manifest of a version.

        Raises:
            ModelNotFound: there is no such version.
            ModelDamaged, ModelIncompatible: it cannot be trusted or understood.
        """
        return self._checked(self._manifest_bytes(name, version), name, version)

    def load(self, name: str, version: int) -> tuple[ShapeModel, Manifest]:
        """A version, checked against its content hashes.

        Raises:
            ModelNotFound: there is no such version.
            ModelDamaged, ModelIncompatible: it cannot be trusted or understood.
        """
        manifest = self.manifest(name, version)
        try:
            return decode(self._tensors(manifest), manifest), manifest
        except ModelDamaged as error:
            raise ModelDamaged(f"{name}:{version} is refused. {error}") from error

    def export(self, name: str, version: int, out_dir: Path) -> list[Path]:
        """Writes `manifest.json` and `model.safetensors` of a version, byte for byte as they are stored.

        Returns:
            The files written.

        Raises:
            ModelNotFound, ModelDamaged, ModelIncompatible: as `load`; then nothing is written.
        """
        raw = self._manifest_bytes(name, version)
        manifest = self._checked(raw, name, version)
        data = self._tensors(manifest)
        decode(data, manifest)
        out_dir.mkdir(parents=True, exist_ok=True)
        files = {out_dir / TENSORS: data, out_dir / "manifest.json": raw}
        for path, content in files.items():
            path.write_bytes(content)
        return sorted(files)

    # Inside

    def _chosen(self, name: str, place: str | None, refused: _Choice | None = None) -> _Choice:
        """The number that a publication takes next, and its time.

        Args:
            name: of the model.
            place: where the choices of a publication that may be repeated are kept, so that each repetition makes the
                same ones; None for one that is not repeated.
            refused: the choice whose number another publication has taken.
        """
        version = max(self.versions(name) + ModelStore(SHIPPED).versions(name), default=0) + 1
        fresh = _Choice((refused.attempt if refused else 0) + 1, version, datetime.now(UTC).replace(microsecond=0))
        if place is None:
            return fresh
        kept = json.dumps({"version": fresh.version, "created": fresh.created.isoformat()}).encode()
        if not self._objects.create_number(place, fresh.attempt, kept):
            facts = json.loads(self._objects.get_number(place, fresh.attempt))
            return _Choice(fresh.attempt, facts["version"], datetime.fromisoformat(facts["created"]))
        return fresh

    def _log(self, name: str, alias: str) -> AliasLog:
        return AliasLog(self._objects, f"models/{name}/aliases/{alias}")

    def _manifest_bytes(self, name: str, version: int) -> bytes:
        try:
            return self._objects.get_number(_versions(name), version)
        except FileNotFoundError:
            raise self._no_version(name, version) from None

    def _checked(self, raw: bytes, name: str, version: int) -> Manifest:
        manifest = read_manifest(raw)
        if (manifest.name, manifest.version) != (name, version):
            raise ModelDamaged(
                f"The manifest at {name}:{version} is that of {manifest.name}:{manifest.version}: moved, or altered."
            )
        return manifest

    def _tensors(self, manifest: Manifest) -> bytes:
        if TENSORS not in manifest.contents:
            raise ModelDamaged(f"The manifest of {manifest.name}:{manifest.version} lists no {TENSORS}.")
        try:
            return self._objects.get(_blob_key(manifest.contents[TENSORS].sha256))
        except FileNotFoundError:
            raise ModelDamaged(f"The tensors of {manifest.name}:{manifest.version} are missing in the store.") from None

    def _require(self, name: str, version: int) -> None:
        if version not in self.versions(name):
            raise self._no_version(name, version)

    def _no_version(self, name: str, version: int) -> ModelNotFound:
        return ModelNotFound(f"There is no version {version} of '{name}'. {self._what_exists(name)}")

    def _no_alias(self, name: str, alias: str) -> ModelNotFound:
        return ModelNotFound(f"There is no '{name}@{alias}'. {self._what_exists(name)}")

    def _what_exists(self, name: str) -> str:
        if versions := self.versions(name):
            aliases = ", ".join(f"{alias} = {version}" for alias, version in self.aliases(name).items())
            return (
                f"'{name}' has the versions {', '.join(map(str, versions))} and the aliases {aliases or '(none)'}: "
                f"write {name}:{versions[-1]} or {name}@ALIAS."
            )
        names = self.names()
        return f"The store holds: {', '.join(names)}." if names else NO_MODEL


def _blob_key(digest: str) -> str:
    return f"blobs/sha256/{digest}.safetensors"


def _versions(name: str) -> str:
    return f"models/{name}/versions"
