"""A model's two files: `manifest.json`, which says how it was made, and `model.safetensors`, which is the model.

Neither holds code: tensors are plain arrays and nothing is ever unpickled. Both bear content hashes, so that an
altered byte is noticed before anything is computed with it.
"""

from __future__ import annotations

import hashlib
import json
import platform
import re
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final, Literal

import numpy as np
import safetensors.numpy
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError
from safetensors import SafetensorError

from service import __version__
from service.engine.errors import InvalidParameter, ModelDamaged, ModelIncompatible
from service.engine.model import ShapeModel
from service.engine.params import ModelParams

FORMAT: Final = "shape-concepts-model"
FORMAT_VERSION = 4
TENSORS = "model.safetensors"
NAME = r"[a-z0-9][a-z0-9-]*"
VARYING = ("name", "version", "created", "job", "digest")  # what two publications of one model may differ in
FOREIGN = {b"\x80": "a Python pickle", b"PK": "a zip archive, as PyTorch writes", b"\x89HDF": "an HDF5 file"}


def _untold(value: object) -> bool:
    """Whether a manifest leaves a field out: models that were published before it existed keep their digests."""
    return value is None


class Content(BaseModel):
    """What one file of a model must be."""

    model_config = ConfigDict(frozen=True)

    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="SHA-256 of the file's bytes, hexadecimal")
    size: int = Field(ge=0, description="length of the file, bytes")


class Manifest(BaseModel):
    """How a model was made, and what its files must be."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=f"^{NAME}$", max_length=63, description="the model's name")
    version: int = Field(ge=1, description="counts up from 1; a published version never changes")
    created: datetime = Field(description="time of publication, UTC")
    format: Literal["shape-concepts-model"] = Field(FORMAT, description="what this file is")
    format_version: int = Field(FORMAT_VERSION, description="layout of the tensors and of this manifest")
    seed: int = Field(description="seed of all random draws of the training")
    params: ModelParams = Field(description="parameters of every stage")
    source: dict[str, JsonValue] = Field(description="where the training clouds came from")
    parent: str | None = Field(
        None,
        pattern=rf"^{NAME}:[0-9]{{1,8}}$",
        description="NAME:VERSION of the model that this one follows, if it was told",
        exclude_if=_untold,
    )
    metrics: dict[str, float] | None = Field(
        None,
        description="figures by which it was judged before it was published, in [0, 1], 1 is best",
        exclude_if=_untold,
    )
    job: str | None = Field(None, description="id of the job that made it, if one did", exclude_if=_untold)
    counts: dict[str, int | list[int]] = Field(
        description="how many prototypes, concepts, motif vertices and the like it holds"
    )
    stimuli_fill: float = Field(description="share of the training stimuli above the cut-off, in [0, 1]")
    filtration_step: float = Field(
        description="step of the filtration times, in [0, 1]: annexation times are its multiples, rounded up, the last "
        "one cut off at 1"
    )
    epsilon_max: float = Field(description="middle of the stretch of filtration time of most annexations, in [0, 1]")
    notes: list[str] = Field(description="what is unusual about this model, in sentences")
    contents: dict[str, Content] = Field(description="files of the model and their hashes")
    libraries: dict[str, str] = Field(description="versions of the software that trained it")
    digest: str = Field(
        description="SHA-256 of this manifest as compact JSON with sorted keys, without name, version, created, job "
        "and digest: equal for models that are the same bit for bit"
    )


def describe(
    model: ShapeModel,
    data: bytes,
    *,
    name: str,
    version: int,
    created: datetime,
    seed: int,
    source: dict[str, Any],
    parent: str | None = None,
    metrics: dict[str, float] | None = None,
    job: str | None = None,
) -> Manifest:
    """The manifest of a model about to be published.

    Args:
        model: the model.
        data: its tensors as `encode` returned them.
        name: what it is published as.
        version: the number it takes.
        created: time of publication.
        seed: of the training.
        source: where the training clouds came from, JSON-able.
        parent: NAME:VERSION of the model that it follows.
        metrics: figures by which it was judged.
        job: id of the job that made it.
    """
    manifest = Manifest(
        name=name,
        version=version,
        created=created.astimezone(UTC).replace(microsecond=0),
        seed=seed,
        params=model.params,
        source=source,
        parent=parent,
        metrics=metrics,
        job=job,
        contents={TENSORS: Content(sha256=sha256(data), size=len(data))},
        libraries=libraries(),
        digest="",
        **model.facts(),
    )
    return manifest.model_copy(update={"digest": _digest(manifest.model_dump(mode="json"))})


def encode(model: ShapeModel) -> bytes:
    """The model's tensors as safetensors; the same model gives the same bytes."""
    tensors = model.to_tensors()
    plain = {name: np.asarray(tensors[name], order="C") for name in sorted(tensors)}
    # A single entry: the order of several is not defined, and the bytes must be.
    return safetensors.numpy.save(plain, metadata={"format": f"{FORMAT}/{FORMAT_VERSION}"})


def decode(data: bytes, manifest: Manifest) -> ShapeModel:
    """The model of a safetensors file, if it is whole and the one that the manifest describes.

    Raises:
        ModelDamaged: the bytes are truncated, altered, or not a shape model.
        ModelIncompatible: they are a shape model of another layout.
    """
    if reason := foreign(data):
        raise ModelDamaged(f"{TENSORS} is {reason}; models are safetensors, and nothing else is ever loaded.")
    expected = manifest.contents.get(TENSORS)
    if expected is None:
        raise ModelDamaged(f"The manifest lists no {TENSORS}.")
    if len(data) != expected.size:
        raise ModelDamaged(
            f"{TENSORS} has {len(data)} bytes where its manifest says {expected.size}: it was cut off or replaced."
        )
    if sha256(data) != expected.sha256:
        raise ModelDamaged(f"{TENSORS} was altered: its SHA-256 is not the {expected.sha256} of its manifest.")
    try:
        tensors = safetensors.numpy.load(data)
        layout = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")]).get("__metadata__", {}).get("format", "")
    except (SafetensorError, ValueError, KeyError) as error:
        raise ModelDamaged(f"{TENSORS} is not a well-formed safetensors file: {error}.") from error
    if not layout.startswith(f"{FORMAT}/"):
        raise ModelDamaged(f"{TENSORS} holds tensors, but not those of a shape model.")
    if layout != f"{FORMAT}/{FORMAT_VERSION}":
        raise ModelIncompatible(f"{TENSORS} has the layout {layout}; this software reads {FORMAT}/{FORMAT_VERSION}.")
    try:
        model = ShapeModel.from_tensors(tensors, manifest.params)
    except (KeyError, ValueError, IndexError, TypeError, AttributeError) as error:
        raise ModelDamaged(f"The tensors of {TENSORS} do not fit together: {error!r}.") from error
    if unexpected := set(tensors) ^ set(model.to_tensors()):
        raise ModelDamaged(f"{TENSORS} lacks tensors, or has foreign ones: {', '.join(sorted(unexpected))}.")
    return model


def write_manifest(manifest: Manifest) -> bytes:
    """The bytes of `manifest.json`."""
    return (json.dumps(manifest.model_dump(mode="json"), indent=2, ensure_ascii=False) + "\n").encode()


def read_manifest(data: bytes) -> Manifest:
    """The manifest in the bytes of `manifest.json`.

    Raises:
        ModelDamaged: the bytes are cut off, altered, or not such a manifest.
        ModelIncompatible: they are one of a layout, or with parameters, that this software does not know.
    """
    if reason := foreign(data):
        raise ModelDamaged(f"The manifest is {reason}.")
    try:
        facts = json.loads(data)
    except ValueError as error:
        raise ModelDamaged(f"The manifest is not JSON, so it was cut off or altered: {error}.") from error
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise ModelDamaged(f"The manifest is not that of a shape model: its format is not '{FORMAT}'.")
    if facts.get("format_version") != FORMAT_VERSION:
        raise ModelIncompatible(
            f"The model has format version {facts.get('format_version')!r}; this software reads {FORMAT_VERSION}. "
            "Use the software that published it, or train the model anew."
        )
    if facts.get("digest") != _digest(facts):
        raise ModelDamaged("The manifest was altered: its digest is not that of its content.")
    try:
        manifest = Manifest.model_validate(facts)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        reason = f"{place}: {first['msg']}"
        raise ModelIncompatible(f"The manifest says something this software does not know: {reason}.") from error
    _check_understood(manifest, facts)
    return manifest


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256."""
    return hashlib.sha256(data).hexdigest()


def foreign(data: bytes) -> str | None:
    """What the bytes are when they are a well-known kind of file that is no part of a model."""
    if not data:
        return "empty"
    if data[8:9] == b"{":  # safetensors, whose first eight bytes are a length and may look like anything
        return None
    return next((kind for magic, kind in FOREIGN.items() if data.startswith(magic)), None)


def _check_understood(manifest: Manifest, facts: dict[str, Any]) -> None:
    """Refuses a manifest of which something was filled in or changed in reading: it would answer as another model.

    Args:
        manifest: what was read.
        facts: what the file says.

    Raises:
        ModelIncompatible: the file does not state parameters that this software has.
        ModelDamaged: it says something in a way in which it is never written.
    """
    understood = manifest.model_dump(mode="json")
    if unstated := _unstated(understood["params"], facts["params"]):
        raise ModelIncompatible(
            f"The model was published by an older version of this software: it does not state {', '.join(unstated)}, "
            "and would answer otherwise with today's defaults. Use the software that published it, or train it anew."
        )
    if _digest(understood) != manifest.digest:
        raise ModelDamaged("The manifest was altered: what it says does not give its digest again.")


def _unstated(understood: dict[str, Any], stated: dict[str, Any], stage: str = "") -> list[str]:
    """Dotted names of the parameters that were understood without being stated."""
    missing: list[str] = []
    for name, value in understood.items():
        if name not in stated:
            missing.append(f"{stage}{name}")
        elif isinstance(value, dict):
            missing += _unstated(value, stated[name], f"{stage}{name}.")
    return missing


def _digest(facts: dict[str, Any]) -> str:
    lasting = {key: value for key, value in facts.items() if key not in VARYING}
    return sha256(json.dumps(lasting, sort_keys=True, separators=(",", ":")).encode())


def libraries() -> dict[str, str]:
    """Versions of what the numbers of a model depend on."""
    versions = {"shape-concepts": __version__, "python": platform.python_version()}
    for library in ("numpy", "scipy", "numba", "scikit-learn", "open3d", "open3d-cpu", "sapien"):
        try:
            versions[library] = version(library)
        except PackageNotFoundError:
            continue
    return versions


def check_name(name: str, what: str) -> None:
    """Refuses a name that no model, alias or dataset can have.

    Args:
        name: the name.
        what: how the message goes on after "the name of a": " model", "n alias".

    Raises:
        InvalidParameter: it is not of the form of `NAME`.
    """
    if not re.fullmatch(NAME, name) or len(name) > 63:
        raise InvalidParameter(
            f"'{name}' cannot be the name of a{what}: such names are lower-case letters, digits and hyphens, "
            "start with a letter or digit, and have at most 63 characters."
        )
