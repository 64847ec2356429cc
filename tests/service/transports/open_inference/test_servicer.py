"""The Open Inference Protocol over gRPC, by a real client of a real server."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import grpc
import httpx
import numpy as np
import pytest
from google.rpc.error_details_pb2 import ErrorInfo
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase
from grpc_status import rpc_status

from service.application import Application
from service.engine.model import ShapeModel
from service.keys import KeyStore
from service.settings import Settings
from service.store import ModelStore
from service.transports.open_inference.generated.inference import grpc_service_pb2 as pb
from service.transports.open_inference.generated.inference.grpc_service_pb2_grpc import GRPCInferenceServiceStub
from service.transports.open_inference.servicer import SERVICE, served
from service.transports.open_inference.signature import OUTPUTS
from tests.service.transports.grpc.conftest import Held, Server

DTYPES = {"FP64": "<f8", "INT64": "<i8", "FP32": "<f4", "BOOL": "?"}
Parameter = pb.InferParameter


@contextmanager
def answering(application: Application) -> Iterator[str]:
    """The address of a server that answers for an application."""
    server = Server(application, beside=[served(application)])
    server.start()
    try:
        yield server.address
    finally:
        server.tell_to_end()
        server.wait_for_the_end()


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"grpc_port": 0})


@pytest.fixture
def channel(application: Application) -> Iterator[grpc.Channel]:
    with answering(application) as address, grpc.insecure_channel(address) as channel:
        yield channel


@pytest.fixture
def stub(channel: grpc.Channel) -> GRPCInferenceServiceStub:
    return GRPCInferenceServiceStub(channel)


def request_of(cloud: np.ndarray, raw: bool = True, **more: Any) -> pb.ModelInferRequest:
    """A request; `more` of its fields."""
    tensor = pb.ModelInferRequest.InferInputTensor(name="cloud", datatype="FP32", shape=cloud.shape)
    if not raw:
        tensor.contents.fp32_contents.extend(cloud.ravel().tolist())
    fields: dict[str, Any] = {"model_name": "tiny", "inputs": [tensor]}
    if raw:
        fields["raw_input_contents"] = [cloud.astype("<f4").tobytes()]
    return pb.ModelInferRequest(**fields | more)


def values_of(response: pb.ModelInferResponse) -> dict[str, Any]:
    """The tensors of an answer, by name."""
    found: dict[str, Any] = {}
    for output, raw in zip(response.outputs, response.raw_output_contents, strict=True):
        found[output.name] = raw
        if output.datatype in DTYPES:
            values = np.frombuffer(raw, DTYPES[output.datatype])
            assert list(values.shape) == list(output.shape)
            found[output.name] = values.tolist()
    return found


def refusal_of(call: Callable[..., Any], *given: Any, **more: Any) -> grpc.RpcError:
    with pytest.raises(grpc.RpcError) as raised:
        call(*given, **more)
    return raised.value


def test_the_service_says_what_it_is_and_what_a_model_takes(
    stub: GRPCInferenceServiceStub, store: ModelStore, model: ShapeModel
) -> None:
    store.publish(model, name="tiny", seed=7, source={}, alias=None)
    assert stub.ServerLive(pb.ServerLiveRequest()).live
    assert stub.ServerReady(pb.ServerReadyRequest()).ready
    assert "binary_tensor_data" in stub.ServerMetadata(pb.ServerMetadataRequest()).extensions
    said = stub.ModelMetadata(pb.ModelMetadataRequest(name="tiny"))
    assert (said.name, list(said.versions)) == ("tiny", ["1", "2"])
    assert [(tensor.name, tensor.datatype, list(tensor.shape)) for tensor in said.inputs] == [
        ("cloud", "FP32", [-1, 3])
    ]
    assert [tensor.name for tensor in said.outputs] == list(OUTPUTS)
    assert list(stub.ModelMetadata(pb.ModelMetadataRequest(name="tiny", version="2")).versions) == ["2"]
    ready = {name: stub.ModelReady(pb.ModelReadyRequest(name=name)).ready for name in ("tiny", "tiny@production", "no")}
    assert ready == {"tiny": True, "tiny@production": True, "no": False}
    assert not stub.ModelReady(pb.ModelReadyRequest(name="tiny", version="3")).ready


def test_without_a_model_it_lives_and_is_not_ready(settings: Settings, tmp_path: Path) -> None:
    application = Application(settings.model_copy(update={"store": str(tmp_path / "empty"), "built_in": False}))
    with answering(application) as address, grpc.insecure_channel(address) as channel:
        stub = GRPCInferenceServiceStub(channel)
        assert stub.ServerLive(pb.ServerLiveRequest()).live
        assert not stub.ServerReady(pb.ServerReadyRequest()).ready
        assert not stub.ModelReady(pb.ModelReadyRequest()).ready
        assert refusal_of(stub.ModelMetadata, pb.ModelMetadataRequest()).code() is grpc.StatusCode.NOT_FOUND
    application.close()


def test_a_client_that_knows_nothing_learns_the_service_by_reflection(channel: grpc.Channel) -> None:
    assert SERVICE in ProtoReflectionDescriptorDatabase(channel).get_services()


def test_the_numbers_are_those_of_the_rest_interface(
    stub: GRPCInferenceServiceStub, client: httpx.Client, cloud: np.ndarray
) -> None:
    file = io.BytesIO()
    np.save(file, cloud)
    expected = client.post("/v1/responses", content=file.getvalue()).json()
    for raw in (True, False):
        response = stub.ModelInfer(request_of(cloud, raw, id="a1"))
        assert (response.model_name, response.model_version, response.id) == ("tiny", "1", "a1")
        values = values_of(response)
        assert list(values) == [name for name, output in OUTPUTS.items() if not output.asked]
        assert values["responses"] == expected["responses"]
        assert values["distances"] == expected["distances"]
        assert [values["concept_ids"][place] for place in values["ranking"]] == [c["id"] for c in expected["concepts"]]


def test_outputs_and_parameters_are_honoured(
    stub: GRPCInferenceServiceStub, client: httpx.Client, cloud: np.ndarray
) -> None:
    file = io.BytesIO()
    np.save(file, cloud * 1000)
    query = "time=0.3&top=2&unit=mm&viewpoint=0,0,-100&stimuli=true"
    expected = client.post(f"/v1/responses?{query}", content=file.getvalue()).json()
    wanted = ["stimuli_value", "responses", "ranking"]
    outputs = [pb.ModelInferRequest.InferRequestedOutputTensor(name=name) for name in wanted]
    parameters = {
        "time": Parameter(double_param=0.3),
        "top": Parameter(int64_param=2),
        "unit": Parameter(string_param="mm"),
        "viewpoint": Parameter(string_param="0,0,-100"),
        "priority": Parameter(uint64_param=3),
    }
    values = values_of(stub.ModelInfer(request_of(cloud * 1000, outputs=outputs, parameters=parameters)))
    assert list(values) == wanted
    assert values["stimuli_value"] == expected["stimuli"]["value"]
    assert values["responses"] == expected["responses"]
    assert len(values["ranking"]) == 2


def test_what_is_wrong_is_told(stub: GRPCInferenceServiceStub, cloud: np.ndarray) -> None:
    def tensor(**more: Any) -> pb.ModelInferRequest.InferInputTensor:
        return pb.ModelInferRequest.InferInputTensor(
            **{"name": "cloud", "datatype": "FP32", "shape": cloud.shape} | more
        )

    wanted = pb.ModelInferRequest.InferRequestedOutputTensor
    raw = cloud.tobytes()
    classes = {"classification": Parameter(int64_param=1)}
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"inputs": []}, "one input"),
        ({"inputs": [tensor(), tensor()], "raw_input_contents": [raw, raw]}, "one input"),
        ({"inputs": [tensor(name="image")]}, "cloud"),
        ({"inputs": [tensor(datatype="FP16")]}, "FP32"),
        ({"inputs": [tensor(shape=[-1, 3])]}, "[N, 3]"),
        ({"inputs": [tensor(shape=[3])]}, "[N, 3]"),
        ({"inputs": [tensor(shape=[2**62, 3])]}, "at most"),
        ({"inputs": [tensor(shape=[4_000_000, 3])]}, "bytes long"),
        ({"inputs": [tensor(shape=[4_000_000, 3])], "raw_input_contents": []}, "by its shape"),
        ({"inputs": [tensor(shape=[0, 3])], "raw_input_contents": [b""]}, "no point"),
        ({"inputs": [tensor(parameters=classes)]}, "parameters"),
        ({"raw_input_contents": [raw[:-1]]}, "bytes long"),
        ({"raw_input_contents": [raw, raw]}, "more than once"),
        ({"raw_input_contents": []}, "by its shape"),
        ({"inputs": [tensor(contents=pb.InferTensorContents(fp32_contents=[1.0]))]}, "more than once"),
        ({"outputs": [wanted(name="classes")]}, "responses"),
        ({"outputs": [wanted(name="responses", parameters=classes)]}, "no classes"),
        ({"parameters": {"tiem": Parameter(double_param=0.5)}}, "time"),
        ({"parameters": {"time": Parameter(double_param=float("nan"))}}, "number"),
        ({"parameters": {"time": Parameter(bool_param=True)}}, "number"),
        ({"parameters": {"unit": Parameter(string_param="m" * 10**5)}}, "300"),
        ({"model_name": "x" * 10**5}, "200"),
        ({"model_version": "1.0"}, "number"),
        ({"id": "x" * 10**5}, "1000"),
    ]
    for more, said in wrong:
        refused = refusal_of(stub.ModelInfer, request_of(cloud, **more))
        assert refused.code() is grpc.StatusCode.INVALID_ARGUMENT, said
        assert said in refused.details()
    missing = refusal_of(stub.ModelInfer, request_of(cloud, model_version="7"))
    assert missing.code() is grpc.StatusCode.NOT_FOUND
    measured_nothing = refusal_of(stub.ModelInfer, request_of(np.full_like(cloud, np.nan)))
    status = rpc_status.from_call(measured_nothing)
    info = ErrorInfo()
    assert any(detail.Unpack(info) for detail in status.details)
    assert info.reason == "NO_FINITE_POINTS"
    assert stub.ModelInfer(request_of(cloud)).model_name == "tiny"


def test_bytes_that_are_no_message_are_refused(channel: grpc.Channel) -> None:
    call = channel.unary_unary(f"/{SERVICE}/ModelInfer")
    assert refusal_of(call, b"\xff" * 100).code() is grpc.StatusCode.INVALID_ARGUMENT


def test_when_there_is_too_much_to_do_it_is_said_at_once(
    stub: GRPCInferenceServiceStub, application: Application, cloud: np.ndarray
) -> None:
    with ExitStack() as stack:
        for _ in range(application.pool.places):
            stack.enter_context(application.pool.admitted())
        refused = refusal_of(stub.ModelInfer, request_of(cloud))
        assert refused.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
        assert stub.ServerLive(pb.ServerLiveRequest()).live
    assert stub.ModelInfer(request_of(cloud)).model_name == "tiny"


def test_the_work_ends_when_the_deadline_has_passed(settings: Settings, cloud: np.ndarray) -> None:
    application = HeldAll(settings)
    with answering(application) as address, grpc.insecure_channel(address) as channel:
        refused = refusal_of(GRPCInferenceServiceStub(channel).ModelInfer, request_of(cloud), timeout=1)
        assert refused.code() is grpc.StatusCode.DEADLINE_EXCEEDED
        assert application.stopped.acquire(timeout=10)
    application.close()


class HeldAll(Held):
    """Begins on every cloud, and goes on with none."""

    def respond(self, cloud: Any, **given: Any) -> Any:
        return super().respond(cloud._replace(name="held"), **given)


def test_without_a_key_nothing_but_health_is_told(settings: Settings, cloud: np.ndarray) -> None:
    application = Application(settings.model_copy(update={"access": "keys"}))
    keys = KeyStore(settings.store)
    right, wrong = keys.create("a", ("answer",)).text, keys.create("b", ("train",)).text
    with answering(application) as address, grpc.insecure_channel(address) as channel:
        stub = GRPCInferenceServiceStub(channel)
        assert stub.ServerLive(pb.ServerLiveRequest()).live
        assert stub.ServerReady(pb.ServerReadyRequest()).ready
        for call, request in (
            (stub.ServerMetadata, pb.ServerMetadataRequest()),
            (stub.ModelMetadata, pb.ModelMetadataRequest(name="tiny")),
            (stub.ModelReady, pb.ModelReadyRequest(name="tiny")),
            (stub.ModelInfer, request_of(cloud)),
        ):
            assert refusal_of(call, request).code() is grpc.StatusCode.UNAUTHENTICATED
            refused = refusal_of(call, request, metadata=[("authorization", f"Bearer {wrong}")])
            assert refused.code() is grpc.StatusCode.PERMISSION_DENIED
            assert call(request, metadata=[("authorization", f"Bearer {right}")])
    application.close()


def test_the_limits_of_a_key_hold(settings: Settings, cloud: np.ndarray) -> None:
    application = Application(settings.model_copy(update={"access": "keys"}))
    keys = KeyStore(settings.store)
    large = request_of(cloud[:501])
    few = keys.create("a", ("answer",), max_points=500).text
    short = keys.create("b", ("answer",), max_body=large.ByteSize() - 1).text
    with answering(application) as address, grpc.insecure_channel(address) as channel:
        stub = GRPCInferenceServiceStub(channel)
        for key, code, limit in (
            (few, grpc.StatusCode.INVALID_ARGUMENT, "500"),
            (short, grpc.StatusCode.RESOURCE_EXHAUSTED, str(large.ByteSize() - 1)),
        ):
            refused = refusal_of(stub.ModelInfer, large, metadata=[("authorization", f"Bearer {key}")])
            assert refused.code() is code
            assert limit in refused.details()
        assert stub.ModelInfer(request_of(cloud[:500]), metadata=[("authorization", f"Bearer {few}")]).model_name
    application.close()
