"""A model file is refused unless it is exactly what was published."""

from __future__ import annotations

import json
import pickle
from datetime import UTC, datetime
from functools import reduce
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from service.engine.cloud import PointCloud
from service.engine.errors import ModelDamaged, ModelIncompatible
from service.engine.model import ShapeModel
from service.model_file import (
    FORMAT,
    FORMAT_VERSION,
    TENSORS,
    VARYING,
    Content,
    Manifest,
    decode,
    describe,
    encode,
    read_manifest,
    sha256,
    write_manifest,
)


@pytest.fixture(scope="module")
def data(model: ShapeModel) -> bytes:
    return encode(model)


@pytest.fixture(scope="module")
def manifest(model: ShapeModel, data: bytes) -> Manifest:
    return describe(model, data, name="tiny", version=1, created=datetime.now(UTC), seed=7, source={"simulated": 8})


def claiming(manifest: Manifest, data: bytes) -> Manifest:
    """A manifest that vouches for other bytes, as a forger would write it."""
    return manifest.model_copy(update={"contents": {TENSORS: Content(sha256=sha256(data), size=len(data))}})


def test_saving_and_loading_is_identity(
    model: ShapeModel, data: bytes, manifest: Manifest, clouds: list[PointCloud]
) -> None:
    loaded = decode(data, read_manifest(write_manifest(manifest)))
    assert encode(loaded) == data
    assert loaded.params == model.params
    for cloud in clouds[:3]:
        np.testing.assert_array_equal(loaded.respond(cloud).responses, model.respond(cloud).responses)


def test_the_same_model_has_the_same_bytes_and_digest_whenever_it_is_published(
    model: ShapeModel, data: bytes, manifest: Manifest
) -> None:
    later = datetime(2040, 1, 1, tzinfo=UTC)
    again = describe(model, encode(model), name="other", version=9, created=later, seed=7, source={"simulated": 8})
    assert encode(model) == data
    assert again.model_dump(exclude=set(VARYING)) == manifest.model_dump(exclude=set(VARYING))
    assert again.digest == manifest.digest


def test_tensors_bear_the_documented_names(data: bytes) -> None:
    tensors = safetensors.numpy.load(data)
    n = len(tensors["stimuli.indptr"]) - 1
    assert tensors["space.edges"].shape == (n - 1, 2)
    for name in ("space.distance", "filtration.distance", "filtration.time"):
        assert tensors[name].shape == (n - 1,)
    assert tensors["space.vertex_heat"].shape == tensors["concepts.assignment"].shape == (n,)
    assert {"dictionary.level_1", "stimuli.data", "stimuli.indices"} <= set(tensors)


@pytest.mark.parametrize("share", np.linspace(0, 1, 25))
def test_an_altered_byte_is_noticed_wherever_it_is(data: bytes, manifest: Manifest, share: float) -> None:
    altered = bytearray(data)
    altered[round(share * (len(data) - 1))] ^= 1
    with pytest.raises(ModelDamaged, match="altered"):
        decode(bytes(altered), manifest)


@pytest.mark.parametrize("share", [0, 1e-5, 0.1, 0.5, 0.99])
def test_a_truncated_file_is_refused(data: bytes, manifest: Manifest, share: float) -> None:
    with pytest.raises(ModelDamaged, match=r"empty|cut off"):
        decode(data[: int(share * len(data))], manifest)
    with pytest.raises(ModelDamaged):
        decode(data[: int(share * len(data))], claiming(manifest, data[: int(share * len(data))]))


def test_each_tensor_is_missed_when_it_is_missing(data: bytes, manifest: Manifest) -> None:
    tensors = safetensors.numpy.load(data)
    for missing in tensors:
        rest = {name: array for name, array in tensors.items() if name != missing}
        forged = safetensors.numpy.save(rest, metadata={"format": f"{FORMAT}/{FORMAT_VERSION}"})
        with pytest.raises(ModelDamaged):
            decode(forged, manifest)
        with pytest.raises(ModelDamaged):
            decode(forged, claiming(manifest, forged))


def test_files_that_are_no_shape_model_are_refused_with_the_reason(manifest: Manifest) -> None:
    tensors = {"weight": np.ones((3, 3), np.float32)}
    foreign = {
        "pickle": pickle.dumps(tensors),
        "zip archive": b"PK\x03\x04" + bytes(200),
        "empty": b"",
        "not those of a shape model": safetensors.numpy.save(tensors),
        "not a well-formed safetensors": b"\xff" * 8 + b"{" + bytes(100),
    }
    for reason, content in foreign.items():
        with pytest.raises(ModelDamaged, match=reason):
            decode(content, claiming(manifest, content))


def test_a_layout_of_later_software_is_refused_as_such(data: bytes, manifest: Manifest) -> None:
    newer = safetensors.numpy.save(safetensors.numpy.load(data), metadata={"format": f"{FORMAT}/{FORMAT_VERSION + 1}"})
    with pytest.raises(ModelIncompatible, match=f"{FORMAT}/{FORMAT_VERSION + 1}"):
        decode(newer, claiming(manifest, newer))
    facts = json.loads(write_manifest(manifest)) | {"format_version": FORMAT_VERSION + 1}
    with pytest.raises(ModelIncompatible, match=f"format version {FORMAT_VERSION + 1}"):
        read_manifest(json.dumps(facts).encode())


def test_an_altered_manifest_is_refused_or_says_the_same_of_the_model(manifest: Manifest) -> None:
    raw = write_manifest(manifest)
    for position in range(0, len(raw), 7):
        altered = raw[:position] + bytes([raw[position] ^ 1]) + raw[position + 1 :]
        try:
            found = read_manifest(altered)
        except (ModelDamaged, ModelIncompatible):
            continue
        assert found.model_dump(exclude=set(VARYING)) == manifest.model_dump(exclude=set(VARYING))


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b'{"name": "x"}', pickle.dumps({}), b"\xff\xfe{}"])
def test_what_is_no_manifest_is_refused(content: bytes) -> None:
    with pytest.raises(ModelDamaged):
        read_manifest(content)


def digested_anew(facts: dict[str, Any]) -> bytes:
    """A manifest whose digest fits what it says, as other software would have published it."""
    lasting = {key: value for key, value in facts.items() if key not in VARYING}
    digest = sha256(json.dumps(lasting, sort_keys=True, separators=(",", ":")).encode())
    return json.dumps(facts | {"digest": digest}).encode()


@pytest.mark.parametrize("place", [(), ("params",), ("params", "stimuli")])
def test_a_manifest_that_says_something_unknown_is_refused_as_incompatible(
    manifest: Manifest, place: tuple[str, ...]
) -> None:
    facts = json.loads(write_manifest(manifest))
    reduce(dict.__getitem__, place, facts)["later"] = 3
    with pytest.raises(ModelIncompatible, match=r"\.".join((*place, "later"))):
        read_manifest(digested_anew(facts))


def test_a_manifest_without_one_of_todays_parameters_is_refused_as_incompatible(manifest: Manifest) -> None:
    for stage, params in manifest.params.model_dump().items():
        for name in params:
            facts = json.loads(write_manifest(manifest))
            del facts["params"][stage][name]
            with pytest.raises(ModelIncompatible, match=rf"older version.* {stage}\.{name},"):
                read_manifest(digested_anew(facts))
        facts = json.loads(write_manifest(manifest))
        del facts["params"][stage]
        with pytest.raises(ModelIncompatible, match=rf"older version.* {stage},"):
            read_manifest(digested_anew(facts))


def test_a_manifest_that_is_not_understood_as_it_is_written_is_refused(manifest: Manifest) -> None:
    facts = json.loads(write_manifest(manifest)) | {"seed": str(manifest.seed)}
    with pytest.raises(ModelDamaged, match="digest"):
        read_manifest(digested_anew(facts))
