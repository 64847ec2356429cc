"""A robot's stream becomes a dataset: by the command, as a process beside the robot."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import zenoh

from service import clouds
from service.application import Application
from service.clouds.frame import Viewpoint
from service.datasets import Datasets
from service.settings import Settings
from service.streams import Stream
from service.transports.zenoh.answering import BODY
from service.transports.zenoh.recording import Recorder
from tests.service.clouds.written import pointcloud2
from tests.service.test_datasets import ply
from tests.service.transports.zenoh.conftest import put
from tests.service.transports.zenoh.waiting import until

ROS_KEY = "0/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/RIHS01_91"


@pytest.fixture
def datasets(settings: Settings) -> Datasets:
    datasets = Datasets(settings.store)
    datasets.create("mugs")
    return datasets


@contextmanager
def recording(settings: Settings, endpoint: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process that records, once it listens."""
    command = [sys.executable, "-m", "service.cli", "datasets", "record", "mugs", "--connect", endpoint, "--json"]
    environment = os.environ | {"SHAPE_CONCEPTS_STORE": settings.store}
    with subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stderr is not None
            assert process.stderr.readline().startswith("listening to")
            yield process
        finally:
            process.kill()


def put_once_heard(robot: zenoh.Session, key: str, payload: bytes, **more: Any) -> None:
    """Publishes as soon as somebody listens: the router tells so a moment later."""
    publisher = robot.declare_publisher(key)
    until(lambda: publisher.matching_status.matching, f"somebody listens to {key}")
    publisher.undeclare()
    put(robot, key, payload, **more)


def lines(process: subprocess.Popen[str]) -> list[dict[str, Any]]:
    output, _ = process.communicate(timeout=30)
    return [json.loads(line) for line in output.splitlines()]


def test_files_are_kept_as_they_came_and_messages_as_npy(
    settings: Settings, datasets: Datasets, endpoint: str, robot: zenoh.Session
) -> None:
    points = clouds.read(ply(1)).points
    with recording(settings, endpoint, "--key", "**", "--frame", "body", "--count", "2") as process:
        put_once_heard(robot, "robots/7/cloud/concepts", b"{}", encoding="application/json")  # an answer is no cloud
        put(robot, "robots/7/cloud", ply(1), encoding="model/ply")
        put(robot, ROS_KEY, pointcloud2(points))
        told = lines(process)
        assert process.returncode == 0
    assert told[-1] == {"dataset": "mugs", "outcomes": {"accepted": 2}, "dropped": 0}
    entries = {entry.key.rpartition("/")[0]: entry for entry in datasets.entries("mugs")}
    assert set(entries) == {"robots/7/cloud", ROS_KEY}
    file, message = entries["robots/7/cloud"], entries[ROS_KEY]
    assert datasets.content(file) == ply(1)
    assert (file.format, file.pose()) == ("ply", BODY)
    assert (message.format, message.pose()) == ("npy", None)
    expected = clouds.read(ply(1), viewpoint=BODY).points
    assert np.array_equal(clouds.read(datasets.content(message)).points, expected)
    assert np.array_equal(clouds.read(datasets.content(file), viewpoint=file.pose()).points, expected)


def test_what_is_no_cloud_is_told_and_recording_goes_on_until_ctrl_c(
    settings: Settings, datasets: Datasets, endpoint: str, robot: zenoh.Session
) -> None:
    with recording(settings, endpoint, "--key", "robots/*/cloud") as process:
        put_once_heard(robot, "robots/1/cloud", b"\x00hello")
        put(robot, "robots/2/cloud", ply(2))
        assert process.stdout is not None
        told = [json.loads(process.stdout.readline()) for _ in range(2)]
        assert [verdict["outcome"] for verdict in told] == ["refused", "accepted"]
        process.send_signal(signal.SIGINT)
        told = lines(process)
        assert process.returncode == 0
    assert told[-1]["outcomes"] == {"accepted": 1, "refused": 1}


def test_it_ends_after_its_time_and_says_that_nothing_came(
    settings: Settings, datasets: Datasets, endpoint: str
) -> None:
    with recording(settings, endpoint, "--key", "nobody/cloud", "--seconds", "0.5") as process:
        assert lines(process) == [{"dataset": "mugs", "outcomes": {}, "dropped": 0}]
        assert process.returncode == 1


def test_the_newest_of_each_key_wins_and_every_other_is_counted(
    settings: Settings, datasets: Datasets, endpoint: str, robot: zenoh.Session
) -> None:
    application = Application(settings)
    recorder = Recorder(application, "mugs", Stream(key="robots/*/cloud"))
    samples: list[zenoh.Sample] = []
    subscriber = robot.declare_subscriber("robots/*/cloud", samples.append)
    for number in range(20):
        put(robot, f"robots/{number % 2}/cloud", ply(number))
    until(lambda: len(samples) == 20, "they came")
    subscriber.undeclare()
    for sample in samples:
        recorder.arrived(sample)
    recorded = list(recorder.record(seconds=1))
    assert [(each.verdict.outcome, each.dropped) for each in recorded] == [("accepted", 9)] * 2
    assert recorder.dropped == 18
    assert sorted(map(datasets.content, datasets.entries("mugs"))) == sorted([ply(18), ply(19)])
    assert application.intake.held == 0
    application.close()


def test_clouds_that_the_memory_has_no_room_for_are_dropped(
    settings: Settings, datasets: Datasets, robot: zenoh.Session
) -> None:
    application = Application(settings.model_copy(update={"max_body": 1024, "max_bodies": 1024}))
    recorder = Recorder(application, "mugs", Stream(key="robots/*/cloud"))
    samples: list[zenoh.Sample] = []
    robot.declare_subscriber("robots/*/cloud", samples.append)
    put(robot, "robots/1/cloud", ply(1))
    until(lambda: len(samples) == 1, "it came")
    recorder.arrived(samples[0])
    assert recorder.dropped == 1
    assert list(recorder.record(seconds=0.2)) == []
    application.close()


def test_a_viewpoint_is_kept_with_the_clouds(settings: Settings, datasets: Datasets) -> None:
    pose = Recorder(Application(settings), "mugs", Stream(key="a", viewpoint="0,0,-1"))._pose
    assert pose == Viewpoint((0, 0, -1))
