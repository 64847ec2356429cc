"""POST /v1/responses, asked over HTTP."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import jsonschema
import numpy as np
import pytest

from service.application import Application, CloudFile
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import ShapeConceptsError
from service.engine.model import ShapeModel
from service.transports.rest import examples
from tests.service.clouds.written import npy, png, pointcloud2
from tests.service.tabletop.seen import block, set_table
from tests.shapes import cloud_of


def answer_of(response: httpx.Response) -> dict[str, Any]:
    assert response.status_code == 200, response.text
    return {key: value for key, value in response.json().items() if key != "timings_ms"}


def as_xyz(cloud: PointCloud) -> bytes:
    return "".join(f"{x} {y} {z}\n" for x, y, z in cloud.points.tolist()).encode()


def test_the_answer_over_http_is_that_of_the_application(
    client: httpx.Client, application: Application, clouds: list[PointCloud]
) -> None:
    for cloud in clouds:
        expected = json.loads(application.respond(cloud, stimuli=True).model_dump_json(exclude={"timings_ms"}))
        response = client.post("/v1/responses", params={"stimuli": True}, content=write_ply(cloud))
        assert answer_of(response) == expected


def test_the_objects_of_a_scene_over_http_are_those_of_the_application(
    client: httpx.Client, application: Application
) -> None:
    data = write_ply(set_table("kinect").cloud)
    assert len(data) < application.settings.max_body
    expected = application.respond_scene(CloudFile(data), segments=True, top=2)
    params = {"scene": "true", "segments": "true", "top": 2}
    answer = client.post("/v1/responses", params=params, content=data).json()
    assert without_timings(answer) == without_timings(json.loads(expected.model_dump_json()))
    assert len(answer["objects"]) == 3
    description = client.get("/openapi.json").json()
    schema = {"$ref": "#/components/schemas/SceneAnswer", "components": description["components"]}
    jsonschema.validate(answer, schema)
    content = description["paths"]["/v1/responses"]["post"]["responses"]["200"]["content"]["application/json"]
    jsonschema.validate(content["examples"]["scene=true"]["value"], schema)
    assert client.post("/v1/responses", params={"scene": "false"}, content=data).json()["responses"]


def without_timings(told: Any) -> Any:
    if isinstance(told, dict):
        return {key: without_timings(value) for key, value in told.items() if key != "timings_ms"}
    return [without_timings(each) for each in told] if isinstance(told, list) else told


def test_a_scene_without_a_plane_is_a_problem_that_says_what_to_send(
    client: httpx.Client, clouds: list[PointCloud]
) -> None:
    lone = cloud_of(block((0, 0, 1), (0.04, 0.04, 0.04)))
    response = client.post("/v1/responses", params={"scene": "true"}, content=write_ply(lone))
    assert (response.status_code, response.json()["type"]) == (422, "urn:shape-concepts:error:no-supporting-plane")
    assert "scene=true" in response.json()["detail"]


def test_a_cloud_may_come_as_body_or_form_in_any_format(client: httpx.Client, clouds: list[PointCloud]) -> None:
    ply, xyz = write_ply(clouds[0]), as_xyz(clouds[0])
    points, cdr = clouds[0].points.astype(float).tolist(), pointcloud2(clouds[0].points)
    message = {"content-type": "application/x-ros-cdr; type=sensor_msgs/msg/PointCloud2"}
    sent = [
        client.post("/v1/responses", content=ply),
        client.post("/v1/responses", content=ply, headers={"content-type": "application/octet-stream"}),
        client.post("/v1/responses", content=ply, headers={"content-type": "model/ply"}),
        client.post("/v1/responses", content=ply, headers={"content-type": "application/x-www-form-urlencoded"}),
        client.post("/v1/responses", content=xyz, headers={"content-type": "text/plain; charset=utf-8"}),
        client.post("/v1/responses", json=points),
        client.post("/v1/responses", json={"points": points, "unit": "m", "viewpoint": [0, 0, 0]}),
        client.post("/v1/responses", content=json.dumps(points)),
        client.post("/v1/responses", content=cdr),
        client.post("/v1/responses", content=cdr, headers=message),
        client.post("/v1/responses", files={"cloud": ("mug.ply", ply)}),
        client.post("/v1/responses", files={"cloud": ("mug.xyz", xyz, "text/plain")}),
        client.post("/v1/responses", files={"cloud": ("mug.bin", ply, "model/ply")}),
    ]
    answers = [answer_of(response) for response in sent]
    assert all(answer == answers[0] for answer in answers)


def test_a_depth_image_is_answered_as_the_points_that_it_shows(client: httpx.Client) -> None:
    """A ball before a wall, in millimetres; the mask keeps the ball."""
    rows, columns = np.indices((120, 160))
    x, y = (columns - 79.5) / 200, (rows - 59.5) / 210
    across = x * x + y * y
    seen = (b := 0.7**2 - (1 + across) * (0.7**2 - 0.1**2)) > 0
    depth = np.where(seen, (0.7 - np.sqrt(np.maximum(b, 0))) / (1 + across), 1.2)
    millimetres = np.round(depth * 1000).astype(np.uint16)
    millimetres[::7] = 0
    camera = {"intrinsics": "200,210,79.5,59.5", "segments": "true"}

    z = np.where(seen & (millimetres > 0), millimetres * 0.001, np.nan)
    points = np.dstack([(columns - 79.5) * z / 200, (rows - 59.5) * z / 210, z])
    expected = answer_of(client.post("/v1/responses", params={"segments": "true"}, content=npy(points)))
    assert expected["extent_m"] == pytest.approx(0.2, abs=0.02)

    mask = png(seen * np.uint8(255))
    cut_out = np.where(seen, millimetres, 0).astype(np.uint16)
    for sent in (
        client.post("/v1/responses", params=camera, files={"cloud": png(millimetres), "mask": mask}),
        client.post("/v1/responses", params=camera, files={"cloud": ("d.png", png(millimetres)), "mask": npy(seen)}),
        client.post("/v1/responses", params=camera, content=png(cut_out), headers={"content-type": "image/png"}),
        client.post("/v1/responses", params=camera, content=npy(cut_out)),
        client.post("/v1/responses", params=camera | {"depth_scale": 0.01}, content=npy(cut_out * 0.1)),
    ):
        assert answer_of(sent) == expected
    assert (np.array(expected["point_segments"]).reshape(seen.shape)[~seen] == -1).all()


def test_parameters_choose_model_time_and_length(client: httpx.Client, clouds: list[PointCloud]) -> None:
    content = write_ply(clouds[0])
    for params in ({}, {"model": "tiny"}, {"model": "tiny:1"}, {"version": 1}, {"alias": "production"}):
        assert answer_of(client.post("/v1/responses", params=params, content=content))["version"] == 1
    answer = answer_of(client.post("/v1/responses", params={"time": 1, "top": 1}, content=content))
    assert answer["time"] == 1
    assert len(answer["concepts"]) == 1
    assert "stimuli" not in answer


def test_concepts_of_the_answers_time_come_first_and_those_of_other_times_follow(
    client: httpx.Client, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    for cloud in clouds:
        answer = answer_of(client.post("/v1/responses", content=write_ply(cloud)))
        own, concepts = model.concepts(), answer["concepts"]
        assert answer["time"] == own.time
        assert len(concepts) == len(answer["responses"]) == len(answer["distances"])
        first, others = concepts[: len(own.ids)], concepts[len(own.ids) :]
        assert {concept["id"] for concept in first} == set(own.ids.tolist())
        assert all(concept["time"] == own.time for concept in first)
        assert all(concept["time"] != own.time for concept in others)
        for listed in (first, others):
            assert [concept["response"] for concept in listed] == sorted(concept["response"] for concept in listed)
        assert [concept["rank"] for concept in concepts] == list(range(1, len(concepts) + 1))


def test_a_time_that_is_asked_for_is_the_time_of_all_concepts(client: httpx.Client, clouds: list[PointCloud]) -> None:
    answer = answer_of(client.post("/v1/responses", params={"time": 0.8}, content=write_ply(clouds[0])))
    assert {concept["time"] for concept in answer["concepts"]} == {answer["time"]} == {0.8}


def test_an_answer_explains_itself_and_segments_every_point_when_it_is_asked_to(
    client: httpx.Client, application: Application, clouds: list[PointCloud]
) -> None:
    for cloud in clouds[:3]:
        expected = application.respond(cloud, explain=True, segments=True)
        params = {"explain": "true", "segments": "true"}
        answer = answer_of(client.post("/v1/responses", params=params, content=write_ply(cloud)))
        assert answer == json.loads(expected.model_dump_json(exclude={"timings_ms"}))
        assert len(answer["point_segments"]) == len(cloud.points)
        plain = answer_of(client.post("/v1/responses", content=write_ply(cloud)))
        assert plain == {key: answer[key] for key in plain}
        assert set(answer) - set(plain) == {"explanation", "point_segments"}


@pytest.mark.parametrize(
    ("params", "parts"),
    [
        ({}, {"responses", "distances"}),
        ({"detail": "concepts"}, set()),
        ({"detail": "responses"}, {"responses", "distances"}),
        ({"detail": "stimuli"}, {"stimuli"}),
        ({"detail": ["stimuli", "explanation"]}, {"stimuli", "explanation"}),
        ({"detail": "concepts, segments"}, {"point_segments"}),
        ({"detail": ["responses,stimuli", "segments"]}, {"responses", "distances", "stimuli", "point_segments"}),
        ({"stimuli": True, "segments": True}, {"responses", "distances", "stimuli", "point_segments"}),
        ({"detail": "concepts", "explain": True}, {"explanation"}),
    ],
)
def test_detail_says_which_parts_an_answer_has_beside_the_ranked_concepts(
    client: httpx.Client, application: Application, clouds: list[PointCloud], params: dict[str, Any], parts: set[str]
) -> None:
    whole = json.loads(application.respond(clouds[0], stimuli=True, explain=True, segments=True).model_dump_json())
    answer = answer_of(client.post("/v1/responses", params=params, content=write_ply(clouds[0])))
    optional = {"responses", "distances", "stimuli", "explanation", "point_segments"}
    assert optional & set(answer) == parts
    assert set(whole) - set(answer) == optional - parts | {"timings_ms"}
    assert answer == {key: whole[key] for key in answer}


def test_points_that_were_not_measured_keep_their_places(client: httpx.Client, clouds: list[PointCloud]) -> None:
    """As an organised cloud has them: a row of NaN wherever nothing returned."""
    lines = as_xyz(clouds[0]).splitlines(keepends=True)
    gaps = b"".join(b"nan nan nan\n" + line for line in lines)
    whole = client.post("/v1/responses", params={"segments": True}, content=as_xyz(clouds[0])).json()
    holed = client.post("/v1/responses", params={"segments": True}, content=gaps).json()
    assert holed["point_segments"][0::2] == [-1] * len(lines)
    assert holed["point_segments"][1::2] == whole["point_segments"]


def test_the_explanation_names_training_objects_that_can_be_looked_at(
    client: httpx.Client, clouds: list[PointCloud]
) -> None:
    explanation = client.post("/v1/responses", params={"explain": 1}, content=write_ply(clouds[0])).json()[
        "explanation"
    ]
    for near in explanation["wholes"]:
        picture = client.get(explanation["thumbnails"].replace("{object}", str(near["object"])))
        assert picture.headers["content-type"] == "image/png"


def test_unit_and_viewpoint_bring_a_cloud_into_the_sensors_frame(
    client: httpx.Client, clouds: list[PointCloud]
) -> None:
    cloud = clouds[0]
    moved = PointCloud((cloud.points * 1000 + [100, 200, 300]).astype(np.float32))
    params = {"unit": "mm", "viewpoint": "100,200,300"}
    answer = answer_of(client.post("/v1/responses", params=params, content=write_ply(moved)))
    expected = answer_of(client.post("/v1/responses", content=write_ply(cloud)))
    assert answer["extent_m"] == pytest.approx(expected["extent_m"], rel=1e-3)
    assert answer["warnings"] == expected["warnings"]


def test_the_documented_examples_are_answered(client: httpx.Client) -> None:
    response = client.post("/v1/responses", content=examples.CLOUD_XYZ, headers={"content-type": "text/plain"})
    answer = answer_of(response)
    assert answer == answer_of(client.post("/v1/responses", json=examples.CLOUD_JSON))
    assert set(answer) == set(examples.ANSWER) - {"timings_ms"}
    assert set(response.json()["timings_ms"]) == set(examples.ANSWER["timings_ms"])
    assert answer["segments"] == examples.ANSWER["segments"] == len(examples.EXPLANATION["segments"])
    assert answer["extent_m"] == pytest.approx(0.144, abs=0.01)


DEPTH = png(np.full((20, 30), 700, np.uint16))
CAMERA = {"intrinsics": "525,525,319.5,239.5"}
XYZ = {"content": b"0.1 0.2 0.9\n"}
REFUSED: list[tuple[str, int, str, dict[str, Any]]] = [
    ("no bytes", 422, "empty-cloud", {"content": b""}),
    ("too few points", 422, "too-few-points", {"content": b"0.1 0.2 0.9\n0.2 0.2 0.9\n0.1 0.3 0.9\n"}),
    ("all NaN", 422, "no-finite-points", {"content": b"nan nan nan\n" * 200}),
    ("all equal", 422, "degenerate-cloud", {"content": b"1 1 1\n" * 200}),
    ("300 m", 422, "implausible-extent", {"content": b"".join(b"%d %d 5\n" % (i, i * i % 300) for i in range(300))}),
    ("far", 422, "distant-cloud", {"content": b"".join(b"%f %f 9e6\n" % (i % 17 / 99, i / 99) for i in range(99)) * 2}),
    ("a truncated file", 400, "unreadable-cloud", {"content": b"ply\nformat ascii 1.0\nelement vertex 10\n"}),
    ("10^12 points", 413, "too-many-points", {"content": b"ply\nformat binary_little_endian 1.0\nelement vertex "
     b"1000000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n" + bytes(120)}),
    ("a picture", 415, "unsupported-format", {"content": b"\xff\xd8", "headers": {"content-type": "image/jpeg"}}),
    ("a depth image without intrinsics", 422, "invalid-parameter", {"content": DEPTH}),
    ("a damaged depth image", 400, "unreadable-cloud", {"content": DEPTH[:-20], "params": CAMERA}),
    ("intrinsics of a cloud", 422, "invalid-parameter", {**XYZ, "params": CAMERA}),
    ("half the intrinsics", 422, "invalid-parameter", {**XYZ, "params": {"intrinsics": "525,525"}}),
    ("a depth scale of 0", 422, "invalid-parameter", {**XYZ, "params": CAMERA | {"depth_scale": 0}}),
    ("a depth scale of NaN", 422, "invalid-parameter", {**XYZ, "params": CAMERA | {"depth_scale": "nan"}}),
    ("a depth scale alone", 422, "invalid-parameter", {**XYZ, "params": {"depth_scale": 0.001}}),
    ("a mask of a cloud", 422, "invalid-parameter", {"files": {"cloud": b"0 0 1\n", "mask": DEPTH}}),
    ("a mask that is none", 400, "unreadable-cloud", {"files": {"cloud": DEPTH, "mask": b"x"}, "params": CAMERA}),
    ("a mask alone", 400, "unreadable-cloud", {"files": {"mask": DEPTH}, "params": CAMERA}),
    ("a mask as text", 400, "unreadable-cloud", {"files": {"cloud": DEPTH}, "data": {"mask": "x"}, "params": CAMERA}),
    ("two clouds", 400, "unreadable-cloud", {"files": [("cloud", b"1 2 3\n")] * 2}),
    ("another file", 400, "unreadable-cloud", {"files": {"cloud": b"1 2 3\n", "scan": b"x"}}),
    ("JSON without points", 400, "unreadable-cloud", {"json": {"unit": "m"}}),
    ("JSON nested deeply", 400, "unreadable-cloud", {"content": b"[" * 10**6,
     "headers": {"content-type": "application/json"}}),
    ("another message", 415, "unsupported-format", {**XYZ, "headers": {"content-type": "application/cdr; type=Image"}}),
    ("no message", 400, "unreadable-cloud", {**XYZ, "headers": {"content-type": "application/cdr"}}),
    ("unknown content", 415, "unsupported-format", {"content": b"\x00\x01\x02"}),
    ("a scene without a table", 422, "no-supporting-plane", {"content": b"1 1 1\n" * 200, "params": {"scene": 1}}),
    ("another format", 400, "unreadable-cloud", {"content": b"ply\n", "headers": {"content-type": "model/x-pcd"}}),
    ("a form without the field", 400, "unreadable-cloud", {"files": {"scan": b"x"}}),
    ("a form with text in the field", 400, "unreadable-cloud", {"data": {"cloud": "x"}, "files": {"scan": b"x"}}),
    ("a form without boundary", 400, "unreadable-cloud", {**XYZ, "headers": {"content-type": "multipart/form-data"}}),
    ("a broken form", 400, "unreadable-cloud", {**XYZ, "headers": {"content-type": "multipart/form-data; boundary=x"}}),
    ("many files", 400, "unreadable-cloud", {"files": [("cloud", b"x")] * 3}),
    ("an unknown model", 404, "model-not-found", {**XYZ, "params": {"model": "nobody"}}),
    ("an unknown version", 404, "model-not-found", {**XYZ, "params": {"version": 99}}),
    ("an unknown alias", 404, "model-not-found", {**XYZ, "params": {"alias": "nobody"}}),
    ("a malformed model", 422, "invalid-parameter", {**XYZ, "params": {"model": "../x"}}),
    ("a contradiction", 422, "invalid-parameter", {**XYZ, "params": {"model": "tiny:1", "version": 1}}),
    ("a time of 2", 422, "invalid-parameter", {**XYZ, "params": {"time": 2}}),
    ("a time of NaN", 422, "invalid-parameter", {**XYZ, "params": {"time": "nan"}}),
    ("an unknown detail", 422, "invalid-parameter", {**XYZ, "params": {"detail": "concepts,all"}}),
    ("half an explanation", 422, "invalid-parameter", {**XYZ, "params": {"explain": "half"}}),
    ("two segments", 422, "invalid-parameter", {**XYZ, "params": {"segments": 2}}),
    ("no concepts", 422, "invalid-parameter", {**XYZ, "params": {"top": 0}}),
    ("a version of 23 digits", 422, "invalid-parameter", {**XYZ, "params": {"version": "9" * 23}}),
    ("a misspelt parameter", 422, "invalid-parameter", {**XYZ, "params": {"toop": 1}}),
    ("version x", 422, "invalid-parameter", {**XYZ, "params": {"version": "x"}}),
    ("an unknown unit", 422, "invalid-parameter", {**XYZ, "params": {"unit": "furlong"}}),
    ("no viewpoint", 422, "invalid-parameter", {**XYZ, "params": {"viewpoint": ""}}),
    ("half a viewpoint", 422, "invalid-parameter", {**XYZ, "params": {"viewpoint": "1,2"}}),
    ("a body too large", 413, "content-too-large", {"content": bytes(2**20 + 1)}),
]  # fmt: skip


@pytest.mark.parametrize(("status", "kind", "request_"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_what_cannot_be_answered_is_refused_with_its_own_problem(
    client: httpx.Client, status: int, kind: str, request_: dict[str, Any]
) -> None:
    response = client.post("/v1/responses", **request_)
    problem = response.json()
    assert (response.status_code, problem["type"]) == (status, f"urn:shape-concepts:error:{kind}"), problem
    assert response.headers["content-type"] == "application/problem+json"
    assert problem["status"] == status
    assert problem["instance"] == f"urn:uuid:{response.headers['x-request-id']}"
    assert len(problem["detail"]) > 10
    documented = client.get("/openapi.json").json()["paths"]["/v1/responses"]["post"]["responses"]
    assert str(status) in documented


def test_a_misspelt_parameter_is_told_those_that_exist(client: httpx.Client) -> None:
    detail = client.post("/v1/responses", params={"toop": 1, "top": 1}, content=b"1 2 3\n").json()["detail"]
    assert "'toop'" in detail
    for name in (
        "model",
        "version",
        "alias",
        "time",
        "top",
        "unit",
        "viewpoint",
        "intrinsics",
        "depth_scale",
        "stimuli",
        "explain",
        "segments",
        "scene",
        "detail",
    ):
        assert f" {name}" in detail
    listed = client.get("/v1/models", params={"name": "tiny"})
    assert (listed.status_code, "none" in listed.json()["detail"]) == (422, True)


def test_every_kind_of_invalid_cloud_was_tried() -> None:
    tried = {kind for _, _, kind, _ in REFUSED}
    kinds = {error.type_name() for error in ShapeConceptsError.__subclasses__() for error in error.__subclasses__()}
    assert kinds <= tried


def test_a_service_at_its_limit_refuses_at_once_and_stays_healthy(
    client: httpx.Client, application: Application, clouds: list[PointCloud]
) -> None:
    content = write_ply(clouds[0])
    places = [application.pool.admitted() for _ in range(application.pool.places)]
    for place in places:
        place.__enter__()
    response = client.post("/v1/responses", content=content)
    assert response.status_code == 429
    assert response.json()["type"] == "urn:shape-concepts:error:overloaded"
    assert int(response.headers["retry-after"]) >= 1
    assert client.get("/healthz").status_code == client.get("/readyz").status_code == 200
    for place in places:
        place.__exit__(None, None, None)
    assert client.post("/v1/responses", content=content).status_code == 200


def test_many_clients_get_the_answers_of_one(client: httpx.Client, clouds: list[PointCloud]) -> None:
    contents = [write_ply(cloud) for cloud in clouds]
    alone = [answer_of(client.post("/v1/responses", content=content)) for content in contents]

    def ask(number: int) -> tuple[int, httpx.Response]:
        return number, client.post("/v1/responses", content=contents[number])

    with ThreadPoolExecutor(8) as threads:
        for number, response in threads.map(ask, list(range(len(contents))) * 4):
            if response.status_code != 429:
                assert answer_of(response) == alone[number]
