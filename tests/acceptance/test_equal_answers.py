"""One process, every wire, real clients: equal answers and equal errors, in one table."""

from __future__ import annotations

import io
import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import grpc
import httpx
import numpy as np
import pytest
import zenoh
from google.protobuf.json_format import MessageToDict

from service.clouds import write_ply
from service.store import ModelStore
from service.transports.grpc.generated.shapeconcepts.v1 import answer_pb2, cloud_pb2, service_pb2
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
from service.transports.open_inference.generated.inference import grpc_service_pb2 as inference
from service.transports.open_inference.generated.inference.grpc_service_pb2_grpc import GRPCInferenceServiceStub
from tests.learnt import learnt, objects
from tests.service.clouds.written import npy
from tests.service.tabletop.seen import set_table
from tests.service.transports.zenoh.router import session

Said = dict[str, Any]
Ask = Callable[[bytes, Said], Said]


class Wires(NamedTuple):
    """Where the process can be asked."""

    http: str
    grpc: str
    zenoh: str


@pytest.fixture(scope="module")
def wires(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Wires]:
    folder = tmp_path_factory.mktemp("service")
    store = ModelStore(folder / "store")
    for _ in range(2):
        store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14})
    with ExitStack() as free:
        sockets = [free.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(3)]
        http, rpc, peer = (each.getsockname()[1] for each in sockets)
    command = [sys.executable, "-m", "service.cli", "serve", "--port", str(http), "--grpc-port", str(rpc)]
    settings = {"STORE": store.url, "ZENOH_LISTEN": f"tcp/127.0.0.1:{peer}", "ACCESS": "auto"}
    environment = os.environ | {f"SHAPE_CONCEPTS_{name}": value for name, value in settings.items()}
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(command, stderr=log, env=environment)
    try:
        found = Wires(f"http://127.0.0.1:{http}", f"127.0.0.1:{rpc}", f"tcp/127.0.0.1:{peer}")
        for _ in range(600):
            try:
                if httpx.get(f"{found.http}/readyz").status_code == 200:
                    break
            except httpx.TransportError:
                assert process.poll() is None, (folder / "log").read_text()
            time.sleep(0.1)
        yield found
    finally:
        process.terminate()
        process.wait(30)


def of_document(document: Said) -> Said:
    return {
        "responses": document["responses"],
        "distances": document["distances"],
        "novelty": document["novelty"],
        "ids": [concept["id"] for concept in document["concepts"]],
    }


def over_rest(wires: Wires) -> Ask:
    def ask(cloud: bytes, params: Said) -> Said:
        response = httpx.post(f"{wires.http}/v1/responses", params=params, content=cloud, timeout=60)
        return of_document(response.json()) if response.status_code == 200 else {"error": response.json()["detail"]}

    return ask


def over_grpc(wires: Wires) -> Ask:
    def ask(cloud: bytes, params: Said) -> Said:
        request = service_pb2.RespondRequest(
            cloud=cloud_pb2.Cloud(file=cloud_pb2.CloudFile(data=cloud)), options=answer_pb2.Options(**params)
        )
        with grpc.insecure_channel(wires.grpc) as channel:
            try:
                answer = ShapeConceptsServiceStub(channel).Respond(request, timeout=60).answer
            except grpc.RpcError as error:
                return {"error": error.details()}
        return {
            "responses": list(answer.responses),
            "distances": list(answer.distances),
            "novelty": answer.novelty,
            "ids": [concept.id for concept in answer.concepts],
        }

    return ask


def over_zenoh(wires: Wires) -> Ask:
    def ask(cloud: bytes, params: Said) -> Said:
        left = {name: value for name, value in params.items() if name != "model"}
        selector = f"shape-concepts/@v1/models/{params.get('model', 'tiny')}/respond"
        selector += "?" + ";".join(f"{name}={value}" for name, value in left.items())
        with session(connect=wires.zenoh) as robot:
            (reply,) = robot.get(selector, payload=cloud, timeout=60, target=zenoh.QueryTarget.BEST_MATCHING)
            document = json.loads(reply.result.payload.to_bytes())
            return of_document(document) if reply.ok is not None else {"error": document["detail"]}

    return ask


def of_tensors(tensors: dict[str, list[Any]]) -> Said:
    ids = [tensors["concept_ids"][place] for place in tensors["ranking"]]
    return {
        "responses": tensors["responses"],
        "distances": tensors["distances"],
        "novelty": tensors["novelty"][0],
        "ids": ids,
    }


def over_open_inference_http(wires: Wires) -> Ask:
    def ask(cloud: bytes, params: Said) -> Said:
        points = np.load(io.BytesIO(cloud)).astype(np.float32)
        left = {name: value for name, value in params.items() if name != "model"}
        data = [None if value != value else value for value in points.ravel().tolist()]  # JSON has no NaN
        tensor = {"name": "cloud", "shape": list(points.shape), "datatype": "FP32", "data": data}
        url = f"{wires.http}/v2/models/{params.get('model', 'tiny')}/infer"
        response = httpx.post(url, json={"inputs": [tensor], "parameters": left}, timeout=60)
        if response.status_code != 200:
            return {"error": response.json()["error"]}
        return of_tensors({output["name"]: output["data"] for output in response.json()["outputs"]})

    return ask


def over_open_inference_grpc(wires: Wires) -> Ask:
    def ask(cloud: bytes, params: Said) -> Said:
        points = np.load(io.BytesIO(cloud)).astype("<f4")
        request = inference.ModelInferRequest(model_name=params.get("model", "tiny"))
        request.inputs.add(name="cloud", datatype="FP32", shape=points.shape)
        request.raw_input_contents.append(points.tobytes())
        for name, value in params.items():
            if name != "model":
                kind = "double_param" if isinstance(value, float) else "int64_param"
                setattr(request.parameters[name], kind, value)
        with grpc.insecure_channel(wires.grpc) as channel:
            try:
                answer = GRPCInferenceServiceStub(channel).ModelInfer(request, timeout=60)
            except grpc.RpcError as error:
                return {"error": error.details()}
        dtypes = {"FP64": "<f8", "INT64": "<i8", "FP32": "<f4"}
        outputs = zip(answer.outputs, answer.raw_output_contents, strict=True)
        return of_tensors({told.name: np.frombuffer(raw, dtypes[told.datatype]).tolist() for told, raw in outputs})

    return ask


WIRES: dict[str, Callable[[Wires], Ask]] = {
    "REST": over_rest,
    "gRPC": over_grpc,
    "zenoh": over_zenoh,
    "Open Inference Protocol, HTTP": over_open_inference_http,
    "Open Inference Protocol, gRPC": over_open_inference_grpc,
}
ASKED: dict[str, Said] = {
    "nothing said": {},
    "the two best": {"top": 2},
    "another time": {"time": 0.5},
    "time and number": {"time": 0.25, "top": 1},
    "a version": {"model": "tiny:1"},
    "an alias": {"model": "tiny@production"},
    "no such model": {"model": "mugs"},
    "no such version": {"model": "tiny:7"},
}


def of_scene(document: Said) -> Said:
    """What the answer to a scene says, as REST writes it, without how long it took."""
    for part in (document, *(one["answer"] for one in document["objects"])):
        del part["timings_ms"]
    return document


def scene_over_rest(wires: Wires, cloud: bytes, params: Said) -> Said:
    response = httpx.post(f"{wires.http}/v1/responses", params=params | {"scene": True}, content=cloud, timeout=60)
    return of_scene(response.json()) if response.status_code == 200 else {"error": response.json()["detail"]}


def scene_over_grpc(wires: Wires, cloud: bytes, params: Said) -> Said:
    sent, options = cloud_pb2.Cloud(file=cloud_pb2.CloudFile(data=cloud)), answer_pb2.Options(**params)
    with grpc.insecure_channel(wires.grpc) as channel:
        try:
            request = service_pb2.RespondSceneRequest(cloud=sent, options=options)
            answer = ShapeConceptsServiceStub(channel).RespondScene(request, timeout=60).answer
        except grpc.RpcError as error:
            return {"error": error.details()}
    said = MessageToDict(answer, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)
    for one in said["objects"]:
        one["box"]["axes"] = list(one["box"]["axes"].values())
        one |= {"error": one.get("error"), "at_border": one.get("at_border")}
        one["answer"].pop("point_segments")
        for concept in one["answer"]["concepts"]:
            concept.setdefault("name", None)
    del said["point_objects"]
    return of_scene(said)


def scene_over_zenoh(wires: Wires, cloud: bytes, params: Said) -> Said:
    left = {name: value for name, value in params.items() if name != "model"}
    selector = f"shape-concepts/@v1/models/{params.get('model', 'tiny')}/respond"
    selector += "?" + ";".join(f"{name}={value}" for name, value in ({"scene": "true"} | left).items())
    with session(connect=wires.zenoh) as robot:
        (reply,) = robot.get(selector, payload=cloud, timeout=60, target=zenoh.QueryTarget.BEST_MATCHING)
        document = json.loads(reply.result.payload.to_bytes())
        return of_scene(document) if reply.ok is not None else {"error": document["detail"]}


@pytest.mark.parametrize("params", ASKED.values(), ids=ASKED)
def test_every_wire_that_takes_scenes_finds_the_same_objects(wires: Wires, params: Said) -> None:
    cloud = write_ply(set_table("kinect").cloud)
    said = [ask(wires, cloud, params) for ask in (scene_over_rest, scene_over_grpc, scene_over_zenoh)]
    assert said[0] == said[1] == said[2]
    assert "error" in said[0] or len(said[0]["objects"]) == 3
    assert ("error" in said[0]) == ("no such" in next(name for name, of in ASKED.items() if of is params))


def test_every_wire_that_takes_scenes_refuses_the_same_one_with_the_same_words(wires: Wires) -> None:
    rng = np.random.default_rng(0)
    for points in (rng.random((12, 3)), np.full((200, 3), np.nan), rng.random((500, 3)) * [1, 0, 0] + [0, 0, 1]):
        cloud = npy(points.astype(np.float32))
        said = [ask(wires, cloud, {}) for ask in (scene_over_rest, scene_over_grpc, scene_over_zenoh)]
        assert said[0] == said[1] == said[2]
        assert "error" in said[0]


@pytest.mark.parametrize("params", ASKED.values(), ids=ASKED)
def test_every_wire_says_the_same(wires: Wires, params: Said) -> None:
    for number, thing in enumerate(objects()[:3]):
        cloud = npy(thing.cloud.points)
        said = {name: over(wires)(cloud, params) for name, over in WIRES.items()}
        assert all(each == said["REST"] for each in said.values()), (number, said)
        assert ("error" in said["REST"]) == ("no such" in next(name for name, of in ASKED.items() if of is params))


def test_every_wire_refuses_the_same_cloud_with_the_same_words(wires: Wires) -> None:
    rng = np.random.default_rng(0)
    for points in (rng.random((12, 3)), np.full((200, 3), np.nan), rng.random((500, 3)) * [1, 0, 0] + [0, 0, 1]):
        cloud = npy(points.astype(np.float32))
        said = {name: over(wires)(cloud, {}) for name, over in WIRES.items()}
        assert "error" in said["REST"]
        assert all(each == said["REST"] for each in said.values()), said


def test_the_example_of_rest_tells_the_same(wires: Wires, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.ply", tmp_path / "bad.ply"
    good.write_bytes(write_ply(objects()[0].cloud))
    bad.write_bytes(b"ply\n")
    command = [sys.executable, "-m", "service.examples.rest_client", "--address", wires.http, str(good), str(bad)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1
    ids = over_rest(wires)(good.read_bytes(), {"top": 3})["ids"]
    found = r", ".join(rf"{number} \(-?\d+\.\d\)" for number in ids)
    assert re.fullmatch(rf"{re.escape(str(good))}: novelty \d\.\d\d, concepts {found}\n", ended.stdout)
    assert str(bad) in ended.stderr
    assert "Traceback" not in ended.stderr
