"""Work on this machine's cores and on a Dask cluster of real processes: the same bits, and clear refusals."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer

import pytest
from joblib import Parallel, delayed

from service.engine.errors import ClusterUnavailable
from service.engine.params import HierarchyParams, ModelParams
from service.job_specs import TrainSpec
from tests.learnt import SIMULATION, learnt, named_clouds, objects
from tests.worker.learning.test_train import fingerprint
from tests.worker.test_job_steps import Told
from worker.job_steps import Place, gather, learn
from worker.learning.train import train
from worker.sharing import shared_out
from worker.simulation import SimulatedObject, simulate

ROOT = Path(__file__).parents[2]
NOWHERE = "tcp://127.0.0.1:9"


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([sys.executable, "-m", "dask", *command], env=environment, cwd=ROOT, **quiet)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    file = folder / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with running("scheduler", *options):
        until = time.monotonic() + 60
        while not (file.exists() and file.stat().st_size):
            assert time.monotonic() < until, "the scheduler does not start"
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"]


@contextmanager
def worker(address: str, threads: int = 1) -> Iterator[subprocess.Popen[bytes]]:
    with running("worker", address, "--nthreads", str(threads), "--no-nanny", "--no-dashboard") as process:
        yield process


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with scheduler(tmp_path_factory.mktemp("cluster")) as address, worker(address), worker(address):
        with shared_out(1, address, patience=60):
            pass
        yield address


def bits(simulated: SimulatedObject) -> tuple[bytes, ...]:
    return tuple(a.tobytes() for a in (simulated.cloud.points, simulated.labels, simulated.faces))


def test_a_cluster_does_the_work_and_leaves_none_to_this_machine(cluster: str):
    with shared_out(1, cluster):
        busy = set(Parallel()(delayed(_pid)() for _ in range(40)))
    assert os.getpid() not in busy
    assert len(busy) <= 2


def _pid() -> int:
    time.sleep(0.02)
    return os.getpid()


def test_a_cluster_learns_the_same_model_bit_for_bit(cluster: str):
    with shared_out(1, cluster):
        model = train(named_clouds(), ModelParams()).model
    assert fingerprint(model) == fingerprint(learnt())
    params = ModelParams(hierarchy=HierarchyParams(max_objects=5))
    models = []
    for where in (None, cluster):
        with shared_out(2, where):
            models.append(fingerprint(train(named_clouds(), params).model))
    assert models[0] == models[1]


def test_a_cluster_simulates_the_same_objects(cluster: str):
    with shared_out(1, cluster):
        simulated = list(simulate(14, 5, params=SIMULATION.but(noise="kinect")))
    assert [bits(o) for o in simulated] == [bits(o) for o in objects()]


def test_a_job_on_a_cluster_keeps_the_same_clouds_and_learns_the_same_model(cluster: str, tmp_path: Path):
    spec = TrainSpec(name="toys", simulate=6, seed=5, simulation={"renderer": "raycast"})
    models = []
    for name, where in (("here", None), ("there", cluster)):
        place = Place(str(tmp_path), name, 1, where)
        assert gather(Told(), spec, place) == 6
        learn(Told(), spec, place)
        models.append(fingerprint(place.files.model(spec.params)))
    assert models[0] == models[1]


@pytest.mark.slow
def test_where_a_worker_is_killed_the_others_do_its_work(tmp_path: Path):
    with (
        scheduler(tmp_path) as address,
        worker(address),
        worker(address) as doomed,
        shared_out(1, address, patience=60),
    ):
        killing = Timer(1.0, doomed.kill)
        killing.start()
        simulated = list(simulate(80, 5, params=SIMULATION.but(noise="kinect")))
        killing.join()
    assert [bits(o) for o in simulated[:14]] == [bits(o) for o in objects()]
    assert [o.index for o in simulated] == list(range(80))


@pytest.mark.parametrize("address", [NOWHERE, "tcp://no-host.invalid:8786", "nonsense://here", "127.0.0.1:none"])
def test_a_scheduler_that_is_not_there_is_told_of(address: str):
    with pytest.raises(ClusterUnavailable, match="No Dask scheduler answers"), shared_out(1, address, patience=1):
        pass


def test_too_few_workers_or_such_of_several_threads_are_told_of(tmp_path: Path):
    with scheduler(tmp_path) as address:
        with pytest.raises(ClusterUnavailable, match="0 workers, and needs 2"), shared_out(1, address, patience=1):
            pass
        refused = pytest.raises(ClusterUnavailable, match="2 threads")
        with worker(address, threads=2), worker(address), refused, shared_out(1, address, patience=60):
            pass


def test_where_dask_is_not_installed_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterUnavailable, match=r"shape-concepts\[cluster\]"), shared_out(1, NOWHERE):
        pass
