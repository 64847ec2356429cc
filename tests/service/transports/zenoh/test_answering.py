"""Streams of clouds, through a real router."""

from __future__ import annotations

import json
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest
import zenoh
from zenoh.ext import z_serialize
from zenoh.handlers import Callback

from service.application import Application, CloudFile
from service.clouds import SceneCloud, parse_camera, write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidParameter
from service.settings import Settings
from service.streams import Stream
from service.transports.zenoh.answering import camera_of, key_of, pose_of
from service.transports.zenoh.source import ros_header
from tests.service.clouds.written import pointcloud2
from tests.service.tabletop.seen import set_table
from tests.service.transports.rest.test_responses import REFUSED, as_xyz
from tests.service.transports.zenoh.conftest import Served, put, replicas, running
from tests.service.transports.zenoh.router import free_endpoint, routing, session
from tests.service.transports.zenoh.test_queries import dented_ball
from tests.service.transports.zenoh.waiting import until

GID = bytes(range(16))


class Heard(NamedTuple):
    key: str
    encoding: str
    document: dict[str, Any]
    attachment: bytes | None


@contextmanager
def hearing(robot: zenoh.Session, key: str) -> Iterator[list[Heard]]:
    """What is published on a key."""
    heard: list[Heard] = []

    def hear(sample: zenoh.Sample) -> None:
        attachment = sample.attachment.to_bytes() if sample.attachment else None
        heard.append(
            Heard(str(sample.key_expr), str(sample.encoding), json.loads(sample.payload.to_bytes()), attachment)
        )

    with robot.declare_subscriber(key, Callback(hear)):
        time.sleep(0.2)  # until the router knows; a question to it comes after what it was told before
        replicas(robot)
        yield heard


def numbered(sequence: int, time_ns: int = 1_700_000_000_000_000_000) -> bytes:
    """An attachment as rmw_zenoh makes it."""
    return struct.pack("<qq", sequence, time_ns) + b"\x10" + GID


def started(served: Served, **stream: Any) -> Application:
    return served(streams=[{"key": "robots/*/cloud"} | stream])


def test_a_cloud_is_answered_beside_its_key_with_its_sequence_and_time(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = started(served, top=3, time=0.8)
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        put(robot, "robots/7/cloud", write_ply(clouds[0]), attachment=numbered(42))
        until(lambda: heard, "an answer")
    expected = json.loads(application.respond(clouds[0], top=3, time=0.8).model_dump_json())
    ((key, encoding, answer, attachment),) = heard
    assert (key, encoding, attachment) == ("robots/7/cloud/concepts", "application/json", numbered(42))
    assert answer.pop("source") == {
        "key": "robots/7/cloud",
        "sequence": 42,
        "time_ns": 1_700_000_000_000_000_000,
        "frame_id": None,
        "stamp_ns": None,
    }
    assert answer.pop("dropped") == 0
    assert {**answer, "timings_ms": 0} == {**expected, "timings_ms": 0}


def test_the_objects_of_a_stream_of_scenes_are_answered(served: Served, robot: zenoh.Session) -> None:
    application = started(served, scene=True)
    scene = set_table("kinect").cloud
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        put(robot, "robots/7/cloud", write_ply(scene))
        until(lambda: heard, "an answer")
    expected = application.respond_scene(SceneCloud(scene))
    found = heard[0].document["objects"]
    assert [each["position_m"] for each in found] == [list(each.position_m) for each in expected.objects]
    assert all(each["answer"]["concepts"] for each in found)


def test_depth_images_are_answered_each_within_its_mask(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    image, mask, params = dented_ball()
    application = started(served, **params)
    cut = z_serialize({"mask": mask}).to_bytes()
    small = z_serialize({"mask": b"P"}).to_bytes()  # would be carried over by its size
    sent = [(1, numbered(1)), (2, cut), (3, cut[:-9]), (4, small), (5, numbered(4))]
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        for number, attachment in sent:
            put(robot, f"robots/{number}/cloud", image, attachment=attachment)
            until(lambda number=number: len(heard) == number, "an answer")
    whole, masked = (
        json.loads(application.respond(CloudFile(image, camera=parse_camera(**params), mask=one)).model_dump_json())
        for one in (None, mask)
    )
    assert whole["responses"] != masked["responses"]
    assert [each.document.get("responses") for each in heard] == [
        whole["responses"], masked["responses"], None, None, whole["responses"]
    ]  # fmt: skip
    assert [each.document.get("type", "").rpartition(":")[2] for each in heard[2:4]] == [
        "invalid-parameter",
        "unreadable-cloud",
    ]
    assert [each.attachment for each in heard] == [numbered(1), None, None, None, numbered(4)]


def test_a_plain_robot_gets_its_own_attachment_and_the_time_of_zenoh_back(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    started(served)
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        now = robot.new_timestamp()
        xyz = as_xyz(clouds[0])
        put(robot, "robots/7/cloud", xyz, encoding="text/plain", attachment=b"mine", timestamp=now)
        until(lambda: heard, "an answer")
        put(robot, "robots/7/cloud", xyz, source_info=zenoh.SourceInfo(robot.id, 9))
        until(lambda: len(heard) == 2, "another answer")
    first, second = heard
    assert (first.attachment, second.attachment) == (b"mine", None)
    sources = first.document["source"], second.document["source"]
    assert [source["sequence"] for source in sources] == [None, 9]
    assert abs(sources[0]["time_ns"] - time.time_ns()) < 60e9
    assert sources[0]["time_ns"] == now.get_time_as_ntp64().as_nanos()


ROS_KEY = (
    "0/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/"
    "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"
)


def test_a_ros_2_robot_is_answered_as_rmw_zenoh_and_the_dds_bridge_publish(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = served(
        streams=[
            {"key": "0/**/sensor_msgs::msg::dds_::PointCloud2_/*"},
            {"key": "*/camera/points"},
        ]
    )
    expected = json.loads(application.respond(clouds[0]).model_dump_json())
    message = pointcloud2(clouds[0].points)
    for key, attachment in ((ROS_KEY, numbered(5)), ("robot7/camera/points", None)):
        with hearing(robot, "**/concepts") as heard:
            put(robot, key, message, attachment=attachment)
            until(lambda heard=heard: heard, "an answer")  # type: ignore[misc]
        ((answered_on, _, answer, carried),) = heard
        assert (answered_on, carried) == (f"{key}/concepts", attachment)
        source = answer["source"]
        assert source["sequence"] == (5 if attachment else None)
        assert (source["frame_id"], source["stamp_ns"]) == ros_header(message)[::-1]  # type: ignore[index]
        assert answer["responses"] == expected["responses"]


def test_what_cannot_be_answered_is_told_on_the_same_key(served: Served, robot: zenoh.Session) -> None:
    served(streams=[{"key": "robots/*/cloud"}], max_body=2**20)
    hostile = [
        (kind, request["content"], request.get("headers", {}).get("content-type", "zenoh/bytes"))
        for _, _, kind, request in REFUSED
        if set(request) <= {"content", "headers"} and "multipart" not in str(request)
    ]
    assert len(hostile) > 10
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        for number, (kind, payload, encoding) in enumerate(hostile):
            put(robot, f"robots/{number}/cloud", payload, encoding=encoding, attachment=numbered(number))
            until(lambda count=number: len(heard) > count, kind)  # type: ignore[misc]
            told = heard[-1]
            assert told.encoding == "application/problem+json"
            assert told.document["type"] == f"urn:shape-concepts:error:{kind}"
            assert told.document["source"]["sequence"] == number
            assert told.attachment == numbered(number)


def test_answers_and_deletions_are_not_taken_for_clouds(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    started(served, key="robots/**")
    with hearing(robot, "robots/**/concepts") as heard:
        robot.delete("robots/7/cloud")
        put(robot, "robots/7/cloud", write_ply(clouds[0]))
        until(lambda: heard, "an answer")
        time.sleep(0.5)
        assert [answer.key for answer in heard] == ["robots/7/cloud/concepts"]


def test_under_load_the_newest_wins_in_order_and_drops_are_counted(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = started(served)
    content = write_ply(clouds[0])
    held = threading.Event()
    release = [application.pool._threads.submit(held.wait) for _ in range(application.settings.workers)]
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        for sequence in range(50):
            for name in "ab":
                put(robot, f"robots/{name}/cloud", content, attachment=numbered(sequence))
        time.sleep(1)
        assert not heard
        held.set()
        until(lambda: sum(answer.document["source"]["sequence"] == 49 for answer in heard) == 2, "the newest of both")
    assert all(future.result() for future in release)
    for name in "ab":
        answers = [answer.document for answer in heard if answer.key == f"robots/{name}/cloud/concepts"]
        sequences = [answer["source"]["sequence"] for answer in answers]
        assert sequences == sorted(set(sequences))
        assert sequences[-1] == 49
        assert len(answers) + sum(answer["dropped"] for answer in answers) == 50


def test_memory_for_waiting_clouds_is_bounded(served: Served, robot: zenoh.Session, clouds: list[PointCloud]) -> None:
    content = write_ply(clouds[0])
    application = served(streams=[{"key": "robots/*/cloud"}], max_body=len(content), max_bodies=3 * len(content))
    held = threading.Event()
    for _ in range(application.settings.workers):
        application.pool._threads.submit(held.wait)
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        for number in range(20):
            put(robot, f"robots/{number}/cloud", content)
        time.sleep(1)
        assert application.intake._held <= 3 * len(content)
        held.set()
        until(lambda: len(heard) >= 3, "answers")
    until(lambda: application.intake._held == 0, "all is given back")


@pytest.mark.parametrize("share", ["key", "cloud"])
def test_two_replicas_share_a_stream_and_answer_nothing_twice(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud], share: str
) -> None:
    begun: Counter[int] = Counter()
    applications = [started(served, share=share) for _ in range(2)]
    for number, application in enumerate(applications):
        _count(application, begun, number)
    content = write_ply(clouds[0])
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        sent = [(f"robots/{name}/cloud", sequence) for sequence in range(3) for name in range(8)]
        for count, (key, sequence) in enumerate(sent, start=1):
            put(robot, key, content, attachment=numbered(sequence, sequence))
            until(lambda count=count: len(heard) >= count, f"answer {count}")  # type: ignore[misc]
        time.sleep(0.5)
    answered = [(answer.document["source"]["key"], answer.document["source"]["sequence"]) for answer in heard]
    assert sorted(answered) == sorted(sent)
    assert sum(begun.values()) == len(sent)
    assert min(begun[0], begun[1]) > 0


def _count(application: Application, begun: Counter[int], number: int) -> None:
    """Counts the clouds that a replica answers, by whom its pool is given."""
    run = application.pool.run

    async def counted(*args: Any, **kwargs: Any) -> Any:
        begun[number] += 1
        return await run(*args, **kwargs)

    application.pool.run = counted  # type: ignore[method-assign]


def test_a_replica_that_leaves_is_followed_by_the_other(
    served: Served, endpoint: str, settings: Settings, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    started(served)
    content = write_ply(clouds[0])
    keys = [f"robots/{number}/cloud" for number in range(8)]
    second = Application(
        Settings(**settings.model_dump() | {"zenoh_connect": [endpoint], "streams": [{"key": "robots/*/cloud"}]})
    )
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        with running(second):
            until(lambda: len(replicas(robot)) == 2, "both are there")
        second.close()
        assert len(replicas(robot)) == 1
        for count, key in enumerate(keys, start=1):
            put(robot, key, content)
            until(lambda count=count: len(heard) >= count, f"an answer to {key}")  # type: ignore[misc]


def test_a_robot_that_vanishes_and_returns_is_answered_again(
    served: Served, endpoint: str, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    started(served)
    content = write_ply(clouds[0])
    with hearing(robot, "robots/*/cloud/concepts") as heard:
        for count in (1, 2):
            with session(connect=endpoint) as other:
                put(other, "robots/7/cloud", content, attachment=numbered(0))
                until(lambda count=count: len(heard) >= count, "an answer")  # type: ignore[misc]


def test_a_router_that_comes_late_or_restarts_is_found_again(settings: Settings, clouds: list[PointCloud]) -> None:
    endpoint = free_endpoint()
    application = Application(
        Settings(**settings.model_dump() | {"zenoh_connect": [endpoint], "streams": [{"key": "robots/*/cloud"}]})
    )
    content = write_ply(clouds[0])
    with running(application):
        for _ in range(2):
            with routing(endpoint), session(connect=endpoint) as robot:
                until(lambda robot=robot: replicas(robot), "the replica is there")  # type: ignore[misc]
                with hearing(robot, "robots/*/cloud/concepts") as heard:
                    put(robot, "robots/7/cloud", content)
                    until(lambda heard=heard: heard, "an answer")  # type: ignore[misc]
    application.close()


def test_a_replica_that_died_while_the_router_was_away_is_not_waited_for(
    settings: Settings, clouds: list[PointCloud]
) -> None:
    endpoint = free_endpoint()
    more = {"zenoh_connect": [endpoint], "streams": [{"key": "robots/*/cloud"}]}
    content = write_ply(clouds[0])
    first, second = (Application(Settings(**settings.model_dump() | more)) for _ in range(2))
    with running(first):
        with running(second), routing(endpoint), session(connect=endpoint) as robot:
            until(lambda: len(replicas(robot)) == 2, "both are there")
            time.sleep(0.5)
        with routing(endpoint), session(connect=endpoint) as robot:
            until(lambda: len(replicas(robot)) == 1, "the one that is left is there")
            for number in range(8):
                with hearing(robot, f"robots/{number}/cloud/concepts") as heard:
                    end = time.monotonic() + 10
                    while not heard:
                        assert time.monotonic() < end, f"robots/{number} is not answered"
                        put(robot, f"robots/{number}/cloud", content)
                        time.sleep(0.5)
    first.close()
    second.close()


def test_after_the_router_restarted_replicas_share_again(settings: Settings, clouds: list[PointCloud]) -> None:
    endpoint = free_endpoint()
    more = {"zenoh_connect": [endpoint], "streams": [{"key": "robots/*/cloud"}]}
    content = write_ply(clouds[0])
    begun: Counter[int] = Counter()
    applications = [Application(Settings(**settings.model_dump() | more)) for _ in range(2)]
    for number, application in enumerate(applications):
        _count(application, begun, number)
    with running(applications[0]), running(applications[1]):
        for _ in range(2):
            with routing(endpoint), session(connect=endpoint) as robot:
                until(lambda robot=robot: len(replicas(robot)) == 2, "both are there")  # type: ignore[misc]
                time.sleep(1)
                begun.clear()
                with hearing(robot, "robots/*/cloud/concepts") as heard:
                    for count in range(1, 17):
                        put(robot, f"robots/{count}/cloud", content)
                        until(lambda heard=heard, count=count: len(heard) >= count, "an answer")  # type: ignore[misc]
                    time.sleep(0.5)
                assert len(heard) == begun[0] + begun[1] == 16
                assert min(begun[0], begun[1]) > 0
    for application in applications:
        application.close()


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_a_peer_or_router_answers_those_who_connect_to_it(
    settings: Settings, clouds: list[PointCloud], mode: str
) -> None:
    endpoint = free_endpoint()
    more = {"zenoh_listen": [endpoint], "zenoh_mode": mode, "streams": [{"key": "robots/*/cloud"}]}
    application = Application(Settings(**settings.model_dump() | more))
    with (
        running(application),
        session("peer" if mode == "peer" else "client", connect=endpoint) as robot,
        hearing(robot, "robots/*/cloud/concepts") as heard,
    ):
        assert len(replicas(robot)) == 1
        put(robot, "robots/7/cloud", write_ply(clouds[0]))
        until(lambda: heard, "an answer")
    application.close()


def test_frames_are_poses_of_the_sensor() -> None:
    assert pose_of(Stream(key="a")) is None
    body = pose_of(Stream(key="a", frame="body"))
    assert body is not None
    forward, left, up = body.rotation.T[2], -body.rotation.T[0], -body.rotation.T[1]
    assert [axis.tolist() for axis in (forward, left, up)] == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    viewed = pose_of(Stream(key="a", viewpoint="1,2,3"))
    assert viewed is not None
    assert viewed.position == (1, 2, 3)


@pytest.mark.parametrize(
    "stream",
    [{"key": "a//b"}, {"key": "a", "publish_to": "/{key}"}, {"key": "a", "viewpoint": "x"},
     {"key": "a", "viewpoint": "1,2,3", "frame": "body"}, {"key": "a", "intrinsics": "1,2,3"},
     {"key": "a", "depth_scale": 0.001}],
)  # fmt: skip
def test_a_stream_that_cannot_be_is_refused_at_the_start(stream: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameter):
        key_of(Stream(**stream)), pose_of(Stream(**stream)), camera_of(Stream(**stream))
