"""The Open Inference Protocol over HTTP, by a real client of a real server."""

from __future__ import annotations

import gzip
import io
import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from service.answer import Answer
from service.application import Application
from service.clouds.claims import quote
from service.engine.model import ShapeModel
from service.keys import KeyStore
from service.settings import Settings
from service.store import ModelStore
from service.transports.open_inference.signature import OUTPUTS
from tests.service.transports.open_inference.conftest import answering, request_of

INFER = "/v2/models/tiny/infer"
LENGTH = "Inference-Header-Content-Length"
DTYPES = {"FP64": "<f8", "INT64": "<i8", "FP32": "<f4", "BOOL": "?"}


WRONG: list[tuple[dict[str, Any], int, str]] = [
    ({"name": "image"}, 422, "cloud"),
    ({"datatype": "FP64"}, 422, "FP32"),
    ({"datatype": "FLOAT"}, 422, "FP32"),
    ({"shape": [0, 3]}, 422, "no point"),
    ({"shape": [-1, 3]}, 422, "[N, 3]"),
    ({"shape": [-5, -3]}, 422, "[N, 3]"),
    ({"shape": [3]}, 422, "[N, 3]"),
    ({"shape": []}, 422, "[N, 3]"),
    ({"shape": [1, 100, 3]}, 422, "[N, 3]"),
    ({"shape": [10**18, 3]}, 413, "5000000"),
    ({"shape": [10**4000, 3]}, 413, "5000000"),
    ({"shape": [4_999_999, 3]}, 400, "14999997"),
    ({"shape": [1, 3]}, 400, "by its shape"),
    ({"shape": [1.5, 3]}, 400, "shape"),
    ({"shape": [True, 3]}, 400, "shape"),
    ({"shape": "100,3"}, 400, "shape"),
    ({"shape": [1] * 17}, 400, "shape"),
    ({"data": []}, 400, "by its shape"),
    ({"data": None}, 400, "data"),
    ({"data": 5}, 400, "data"),
    ({"data": "AAAA"}, 400, "data"),
    ({"data": ["1", "2"]}, 400, "numbers"),
    ({"data": {"a": 1}}, 400, "data"),
    ({"data": [True] * 300}, 400, "numbers"),
    ({"data": [[1, 2], [3, 4]] * 100}, 400, "numbers"),
    ({"data": [[[1, 2, 3]]] * 300}, 400, "numbers"),
    ({"data": [1e39] * 30000}, 400, "FP32"),
    ({"parameters": {"tiem": 0.5}}, 422, "time"),
    ({"parameters": {"time": 2}}, 422, "0 to 1"),
    ({"parameters": {"time": "late"}}, 422, "number"),
    ({"parameters": {"time": True}}, 422, "number"),
    ({"parameters": {"time": 10**400}}, 422, "number"),
    ({"parameters": {"top": 0}}, 422, "at least 1"),
    ({"parameters": {"top": 1.5}}, 422, "at least 1"),
    ({"parameters": {"unit": "mile"}}, 422, "mile"),
    ({"parameters": {"unit": "m" * 301}}, 422, "300"),
    ({"parameters": {"viewpoint": [0, 0, 0]}}, 422, "text"),
    ({"parameters": {"viewpoint": "1,2"}}, 422, "viewpoint"),
    ({"parameters": {"binary_data_output": 1}}, 422, "true or false"),
    ({"parameters": []}, 400, "parameters"),
    ({"outputs": [{"name": "classes"}]}, 422, "responses"),
    ({"outputs": [{"name": "novelty"}] * 2}, 422, "twice"),
    ({"outputs": [{}]}, 400, "name"),
    ({"outputs": [{"name": "responses", "parameters": {"classification": 3}}]}, 422, "ranking"),
    ({"id": "x" * 1001}, 422, "1000"),
    ({"id": 5}, 400, "id"),
    ({"inputs": []}, 400, "inputs"),
    ({"inputs": None}, 400, "inputs"),
    ({"inputs": [{"name": "cloud"}]}, 400, "datatype"),
    ({"more": "x" * 70000}, 400, "long"),
]


class Faulty(Application):
    """An application with a fault of ours."""

    def respond(self, *given: Any, **more: Any) -> Answer:
        raise RuntimeError("the inside")


def npy(cloud: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, cloud.astype("<f4"))
    return file.getvalue()


def binary(cloud: np.ndarray, size: int | None = None, **more: Any) -> tuple[bytes, dict[str, str]]:
    """Body and headers of a request with the cloud as bytes."""
    tail = cloud.astype("<f4").tobytes()
    sent = {"name": "cloud", "datatype": "FP32", "shape": list(cloud.shape)}
    sent["parameters"] = {"binary_data_size": len(tail) if size is None else size}
    head = json.dumps({"inputs": [sent], **more}).encode()
    return head + tail, {LENGTH: str(len(head))}


def values_of(response: httpx.Response) -> dict[str, Any]:
    """The tensors of an answer, by name, however they were sent."""
    assert response.status_code == 200, response.text
    length = int(response.headers.get(LENGTH, len(response.content)))
    tail = response.content[length:]
    found: dict[str, Any] = {}
    for output in json.loads(response.content[:length])["outputs"]:
        if "data" in output:
            found[output["name"]] = output["data"]
        else:
            size = output["parameters"]["binary_data_size"]
            own, tail = tail[:size], tail[size:]
            found[output["name"]] = own
            if output["datatype"] in DTYPES:
                values = np.frombuffer(own, DTYPES[output["datatype"]])
                assert list(values.shape) == output["shape"]
                found[output["name"]] = values.tolist()
    assert tail == b""
    return found


class TestMetadata:
    def test_the_server_says_what_it_can(self, client: httpx.Client) -> None:
        said = client.get("/v2").json()
        assert said["name"] == "shape-concepts"
        assert "binary_tensor_data" in said["extensions"]
        assert client.get("/v2/health/live").json() == {"live": True}
        assert client.get("/v2/health/ready").json() == {"ready": True}

    def test_a_model_says_what_it_takes_and_gives(self, client: httpx.Client, store: ModelStore, model: ShapeModel):
        store.publish(model, name="tiny", seed=7, source={}, alias=None)
        said = client.get("/v2/models/tiny").json()
        assert (said["name"], said["versions"]) == ("tiny", ["1", "2"])
        assert said["inputs"] == [{"name": "cloud", "datatype": "FP32", "shape": [-1, 3]}]
        assert [output["name"] for output in said["outputs"]] == list(OUTPUTS)
        assert client.get("/v2/models/tiny/versions/2").json()["versions"] == ["2"]
        for path in ("/v2/models/tiny", "/v2/models/tiny/versions/2"):
            assert client.get(f"{path}/ready").json() == {"name": "tiny", "ready": True}

    def test_a_model_that_is_not_there_is_not_found(self, client: httpx.Client) -> None:
        for path in ("none", "tiny/versions/2", "tiny@staging", "tiny/versions/99999999"):
            for refused in (client.get(f"/v2/models/{path}"), client.get(f"/v2/models/{path}/ready")):
                assert refused.status_code == 404
                assert list(refused.json()) == ["error"]

    def test_a_version_is_a_number(self, client: httpx.Client) -> None:
        for version in ("x", "-1", "1.0", "production", "١", "123456789"):
            assert client.get(f"/v2/models/tiny/versions/{version}").status_code == 422

    def test_other_paths_and_methods_are_refused_in_the_protocols_own_way(self, client: httpx.Client) -> None:
        for response, status in (
            (client.get("/v2/nothing"), 404),
            (client.get("/v2nothing"), 404),
            (client.get(INFER), 405),
            (client.post("/v2/health/live"), 405),
        ):
            assert response.status_code == status
            assert list(response.json()) == ["error"]
        assert client.get("/v1/nothing").headers["Content-Type"] == "application/problem+json"

    def test_without_a_model_it_lives_and_is_not_ready(self, settings: Settings, tmp_path: Any) -> None:
        application = Application(settings.model_copy(update={"store": str(tmp_path / "empty"), "built_in": False}))
        with answering(application) as client:
            assert client.get("/v2/health/live").status_code == 200
            refused = client.get("/v2/health/ready")
            assert refused.status_code == 503
            assert "train" in refused.json()["error"]
        application.close()


class TestAnswers:
    def test_json_and_bytes_have_the_numbers_of_the_rest_interface(self, client: httpx.Client, cloud: np.ndarray):
        expected = client.post("/v1/responses", content=npy(cloud)).json()
        body, headers = binary(cloud)
        asked_for_bytes, _ = binary(cloud, parameters={"binary_data_output": True})
        answers = [
            client.post(INFER, json=request_of(cloud)),
            client.post(INFER, json=request_of(cloud, data=cloud.tolist())),
            client.post(INFER, content=body, headers=headers),
            client.post(INFER, json=request_of(cloud, parameters={"binary_data_output": True})),
            client.post(INFER, content=asked_for_bytes, headers={LENGTH: str(len(asked_for_bytes) - cloud.nbytes)}),
        ]
        assert [LENGTH in answer.headers for answer in answers] == [False, False, False, True, True]
        for answer in answers:
            values = values_of(answer)
            assert list(values) == [name for name, output in OUTPUTS.items() if not output.asked]
            assert values["responses"] == expected["responses"]
            assert values["distances"] == expected["distances"]
            assert values["novelty"] == [expected["novelty"]]
            for place, concept in zip(values["ranking"], expected["concepts"], strict=True):
                assert values["concept_ids"][place] == concept["id"]
                assert values["concept_times"][place] == concept["time"]
                assert values["responses"][place] == concept["response"]

    def test_only_the_outputs_asked_for_are_given_each_as_it_was_asked_for(self, client: httpx.Client, cloud):
        expected = client.post("/v1/responses?stimuli=true&segments=true", content=npy(cloud)).json()
        wanted = ["stimuli_value", "novelty", "stimuli_index", "point_segments", "truncated", "extent_m", "segments"]
        outputs = [{"name": name, "parameters": {"binary_data": place % 2 == 0}} for place, name in enumerate(wanted)]
        values = values_of(client.post(INFER, json=request_of(cloud, outputs=outputs)))
        assert list(values) == wanted
        assert values["stimuli_value"] == expected["stimuli"]["value"]
        assert values["stimuli_index"] == expected["stimuli"]["index"]
        assert values["point_segments"] == expected["point_segments"]
        assert values["extent_m"] == [expected["extent_m"]]
        assert values["segments"] == [expected["segments"]]
        assert values["truncated"] == [expected["truncated"]]

    def test_the_wish_of_one_output_goes_before_that_for_all(self, client: httpx.Client, cloud: np.ndarray) -> None:
        outputs = [{"name": "responses"}, {"name": "novelty", "parameters": {"binary_data": False}}]
        sent = request_of(cloud, outputs=outputs, parameters={"binary_data_output": True})
        answer = client.post(INFER, json=sent)
        said = json.loads(answer.content[: int(answer.headers[LENGTH])])["outputs"]
        assert ["data" in output for output in said] == [False, True]

    def test_parameters_mean_what_they_mean_over_rest(self, client: httpx.Client, cloud: np.ndarray) -> None:
        query = "time=0.3&top=2&unit=mm&viewpoint=0,0,-100"
        expected = client.post(f"/v1/responses?{query}", content=npy(cloud * 1000)).json()
        parameters = {"time": 0.3, "top": 2, "unit": "mm", "viewpoint": "0,0,-100"}
        for given in (parameters, parameters | {"time": "0.3", "sequence_id": 5, "triton_more": 1}):
            values = values_of(client.post(INFER, json=request_of(cloud * 1000, parameters=given)))
            assert values["responses"] == expected["responses"]
            assert len(values["ranking"]) == 2
            assert set(values["concept_times"]) == {0.3}

    def test_what_is_odd_about_a_cloud_is_told_as_text(self, client: httpx.Client, cloud: np.ndarray) -> None:
        behind = cloud * np.float32([1, 1, -1])
        expected = client.post("/v1/responses", content=npy(behind)).json()["warnings"]
        assert expected
        outputs = [{"name": "warnings", "parameters": {"binary_data": way}} for way in (False, True)]
        assert values_of(client.post(INFER, json=request_of(behind, outputs=outputs[:1])))["warnings"] == expected
        packed = values_of(client.post(INFER, json=request_of(behind, outputs=outputs[1:])))["warnings"]
        assert packed == b"".join(len(text.encode()).to_bytes(4, "little") + text.encode() for text in expected)

    def test_the_model_its_concrete_version_and_the_requests_id_are_echoed(
        self, client: httpx.Client, cloud: np.ndarray, store: ModelStore, model: ShapeModel
    ) -> None:
        store.publish(model, name="tiny", seed=7, source={}, alias="staging")
        for path, version in (("tiny", "1"), ("tiny/versions/2", "2"), ("tiny@staging", "2")):
            said = client.post(f"/v2/models/{path}/infer", json=request_of(cloud, id="a1")).json()
            assert (said["model_name"], said["model_version"], said["id"]) == ("tiny", version, "a1")
        assert "id" not in client.post(INFER, json=request_of(cloud)).json()

    def test_bodies_may_be_compressed_and_requests_are_named(self, client: httpx.Client, cloud: np.ndarray) -> None:
        body, headers = binary(cloud)
        plain = client.post(INFER, content=body, headers=headers)
        assert plain.headers["X-Request-ID"]
        packed = headers | {"Content-Encoding": "gzip"}
        assert client.post(INFER, content=gzip.compress(body), headers=packed).content == plain.content
        for bad in (gzip.compress(body)[:-20], body):
            refused = client.post(INFER, content=bad, headers=packed)
            assert (refused.status_code, list(refused.json())) == (400, ["error"])
        refused = client.post(INFER, content=body, headers=headers | {"Content-Encoding": "br"})
        assert (refused.status_code, list(refused.json())) == (415, ["error"])

    def test_what_was_not_measured_is_nan_or_null(self, client: httpx.Client, cloud: np.ndarray) -> None:
        holes = cloud.copy()
        holes[::7] = np.nan
        expected = client.post("/v1/responses", content=npy(holes)).json()["responses"]
        body, headers = binary(holes)
        data = [None if np.isnan(value) else value for value in holes.ravel().tolist()]
        for answer in (
            client.post(INFER, content=body, headers=headers),
            client.post(INFER, json=request_of(cloud, data=data)),
            client.post(INFER, content=json.dumps(request_of(holes))),  # NaN, as some write it
        ):
            assert values_of(answer)["responses"] == expected


class TestRefusals:
    def test_what_is_wrong_is_told(self, client: httpx.Client, cloud: np.ndarray) -> None:
        for more, status, said in WRONG:
            refused = client.post(INFER, content=json.dumps(request_of(cloud, **more)))
            assert refused.status_code == status, (quote(more), refused.text)
            assert list(refused.json()) == ["error"]
            assert said in refused.json()["error"]
            assert len(refused.json()["error"]) < 1500
        assert client.post(INFER, json=request_of(cloud)).status_code == 200

    def test_a_body_that_is_no_request_is_refused(self, client: httpx.Client) -> None:
        for body in (b"", b"[]", b"{", b"null", b"\xff\xfe", b"[" * 60000, b'{"inputs":' * 5000):
            refused = client.post(INFER, content=body)
            assert refused.status_code == 400
            assert list(refused.json()) == ["error"]

    def test_a_body_cut_off_anywhere_is_refused(self, client: httpx.Client, cloud: np.ndarray) -> None:
        body = json.dumps(request_of(cloud)).encode()
        packed, headers = binary(cloud)
        for share in (0.0, 0.001, 0.01, 0.3, 0.999):
            assert client.post(INFER, content=body[: int(share * len(body))]).status_code == 400
            cut = client.post(INFER, content=packed[: int(share * len(packed))], headers=headers)
            assert cut.status_code == 400
            assert "cut off" in cut.json()["error"]
        assert client.post(INFER, content=body[:-1]).status_code == 400

    def test_bytes_that_are_not_as_many_as_announced_are_refused(self, client: httpx.Client, cloud) -> None:
        body, headers = binary(cloud)
        length = int(headers[LENGTH])
        for content, header in (
            (body + b"0", {LENGTH: str(length)}),
            (body, {}),
            (body, {LENGTH: str(length - 1)}),
            (body, {LENGTH: "-1"}),
            (body, {LENGTH: "1e3"}),
            (body, {LENGTH: "9" * 5000}),
            (body, {LENGTH: "0"}),
            binary(cloud, size=-12),
            binary(cloud, size=10**18),
            binary(cloud, size=12),
            (body.replace(b"binary_data_size", b"binary_data_sice"), headers),
        ):
            refused = client.post(INFER, content=content, headers=header)
            assert refused.status_code == 400, refused.text
            assert list(refused.json()) == ["error"]
        both = json.dumps(request_of(cloud)).replace('"data"', '"parameters": {"binary_data_size": 0}, "data"')
        assert "both" in client.post(INFER, content=both).json()["error"]

    def test_a_shape_that_fits_the_bytes_of_another_is_refused(self, client: httpx.Client, cloud: np.ndarray) -> None:
        body, headers = binary(cloud)
        other = body.replace(json.dumps(list(cloud.shape)).encode(), b"[%d, 3]" % (10 ** len(str(len(cloud))) // 10))
        assert other != body
        refused = client.post(INFER, content=other, headers=headers)
        assert refused.status_code == 400
        assert "bytes long" in refused.json()["error"]

    def test_clouds_that_cannot_be_answered_are_told_as_over_rest(self, client: httpx.Client, cloud) -> None:
        for bad in (cloud[:5], np.full_like(cloud, np.nan), np.ones_like(cloud), cloud * 1e6):
            expected = client.post("/v1/responses", content=npy(bad))
            body, headers = binary(bad)
            refused = client.post(INFER, content=body, headers=headers)
            assert (refused.status_code, refused.json()) == (422, {"error": expected.json()["detail"]})

    def test_a_body_beyond_the_limit_is_refused_before_it_is_read(self, client: httpx.Client, application) -> None:
        refused = client.post(INFER, content=bytes(application.settings.max_body + 1))
        assert refused.status_code == 413
        assert list(refused.json()) == ["error"]

    def test_an_unforeseen_fault_tells_nothing_of_the_inside(self, settings: Settings, cloud: np.ndarray) -> None:
        application = Faulty(settings)
        with answering(application) as client:
            refused = client.post(INFER, json=request_of(cloud))
            assert refused.status_code == 500
            assert refused.json() == {"error": "The service failed unexpectedly; its log says more."}
        application.close()

    def test_when_there_is_too_much_to_do_it_says_when_to_come_back(
        self, client: httpx.Client, application: Application, cloud: np.ndarray
    ) -> None:
        with ExitStack() as stack:
            for _ in range(application.pool.places):
                stack.enter_context(application.pool.admitted())
            refused = client.post(INFER, json=request_of(cloud))
            assert (refused.status_code, list(refused.json())) == (429, ["error"])
            assert int(refused.headers["Retry-After"]) >= 1
            assert client.get("/v2/health/live").status_code == 200
        assert client.post(INFER, json=request_of(cloud)).status_code == 200


def test_without_a_key_nothing_but_health_is_told(settings: Settings, cloud: np.ndarray) -> None:
    application = Application(settings.model_copy(update={"access": "keys"}))
    keys = KeyStore(settings.store)
    right, wrong = keys.create("a", ("answer",)).text, keys.create("b", ("train",)).text
    with answering(application) as client:
        assert client.get("/v2/health/live").status_code == 200
        assert client.get("/v2/health/ready").status_code == 200
        asked = (("GET", "/v2"), ("GET", "/v2/models/tiny"), ("GET", "/v2/models/tiny/ready"), ("POST", INFER))
        for method, path in asked:
            refused = client.request(method, path, json=request_of(cloud))
            assert refused.status_code == 401
            assert list(refused.json()) == ["error"]
            assert refused.headers["WWW-Authenticate"] == "Bearer"
            for key, status in ((wrong, 403), (right, 200)):
                headers = {"Authorization": f"Bearer {key}"}
                assert client.request(method, path, json=request_of(cloud), headers=headers).status_code == status
    application.close()


def test_the_limits_of_a_key_hold(settings: Settings, cloud: np.ndarray) -> None:
    application = Application(settings.model_copy(update={"access": "keys"}))
    keys = KeyStore(settings.store)
    large = json.dumps(request_of(cloud[:501])).encode()
    few, short = keys.create("a", ("answer",), max_points=500), keys.create("b", ("answer",), max_body=len(large) - 1)
    with answering(application) as client:

        def ask(content: bytes, key: str) -> httpx.Response:
            return client.post(INFER, content=content, headers={"Authorization": f"Bearer {key}"})

        for key, limit in ((few.text, "500"), (short.text, str(len(large) - 1))):
            refused = ask(large, key)
            assert (refused.status_code, list(refused.json())) == (413, ["error"])
            assert limit in refused.json()["error"]
        assert ask(json.dumps(request_of(cloud[:500])).encode(), few.text).status_code == 200
    application.close()


def test_the_built_in_model_says_its_version_as_any_other(settings: Settings, tmp_path: Path) -> None:
    application = Application(settings.model_copy(update={"store": str(tmp_path / "nothing"), "built_in": True}))
    with answering(application) as client:
        assert client.get("/v2/models/default").json()["versions"] == ["1"]
        assert client.get("/v2/models/default/versions/1").json()["versions"] == ["1"]
    application.close()
