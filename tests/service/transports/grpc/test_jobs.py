"""JobsService by a real client of a real server; no worker is needed to submit, look, follow and cancel."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import grpc
import pytest

from service.application import Application
from service.jobs import Jobs
from service.keys import KeyStore
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1 import jobs_pb2 as pb
from service.transports.grpc.generated.shapeconcepts.v1.jobs_pb2_grpc import JobsServiceStub
from service.transports.grpc.job_messages import to_spec
from tests.service.transports.grpc.conftest import Server

TRAIN = pb.JobSpec(train=pb.TrainJob(name="toys", simulate=2))


@pytest.fixture
def jobs(channel: grpc.Channel) -> JobsServiceStub:
    return JobsServiceStub(channel)


@pytest.fixture
def queue(settings: Settings) -> Iterator[Jobs]:
    """The queue, as a worker has it."""
    queue = Jobs(settings.jobs_url)
    yield queue
    queue.close()


def submit(jobs: JobsServiceStub, job: str, spec: pb.JobSpec = TRAIN) -> pb.Job:
    return jobs.Submit(pb.SubmitRequest(id=job, spec=spec), timeout=30).job


def test_a_job_submitted_twice_is_one_job_and_stands_in_the_queue(jobs: JobsServiceStub, queue: Jobs) -> None:
    assert submit(jobs, "nightly") == submit(jobs, "nightly")
    job = jobs.Get(pb.GetRequest(id="nightly")).job
    assert (job.state, job.spec["simulate"], job.HasField("started")) == (pb.JOB_STATE_QUEUED, 2, False)
    assert queue.show("nightly").spec == to_spec(TRAIN)
    with pytest.raises(grpc.RpcError) as refused:
        submit(jobs, "nightly", pb.JobSpec(train=pb.TrainJob(name="toys", simulate=3)))
    assert refused.value.code() == grpc.StatusCode.INVALID_ARGUMENT


def test_every_kind_of_job_is_understood() -> None:
    train = pb.TrainJob(name="toys", datasets=["a", "b"], alias="", seed=2**63 - 1, labelled="c", parent="toys:1")
    train.params.update({"patches": {"iterations": 3}})
    train.simulation.update({"renderer": "raycast"})
    spec = to_spec(pb.JobSpec(train=train, timeout_s=1.5, attempts=2))
    assert spec.kind == "train"
    assert (spec.alias, spec.datasets, spec.seed, spec.timeout, spec.attempts) == (None, ("a", "b"), 2**63 - 1, 1.5, 2)
    assert (spec.params.patches.iterations, spec.simulation) == (3, {"renderer": "raycast"})
    more = pb.TrainJob(name="toys", extend="toys@x", labelled="c", promote=pb.PROMOTION_NOT_WORSE, tolerance=0.5)
    extending = to_spec(pb.JobSpec(train=more))
    assert extending.kind == "train"
    assert (extending.extend, extending.promote, extending.tolerance) == ("toys@x", "not-worse", 0.5)
    evaluated = to_spec(pb.JobSpec(evaluate=pb.EvaluateJob(model="toys@x", dataset="c", robustness=True)))
    assert evaluated.model_dump(exclude_defaults=True) == {"model": "toys@x", "dataset": "c", "robustness": True}
    simulated = to_spec(pb.JobSpec(simulate=pb.SimulateJob(dataset="c", count=9)))
    assert simulated.model_dump(exclude_defaults=True) == {"dataset": "c", "count": 9}
    assert to_spec(TRAIN).model_dump(exclude_defaults=True) == {"name": "toys", "simulate": 2}


@pytest.mark.parametrize(
    "spec",
    [
        pb.JobSpec(),
        pb.JobSpec(train=pb.TrainJob(name="toys")),
        pb.JobSpec(train=pb.TrainJob(name="Not A Name", simulate=2)),
        pb.JobSpec(train=pb.TrainJob(name="toys", simulate=2, promote=9)),
        pb.JobSpec(train=pb.TrainJob(name="toys", extend="nobody:3")),
        pb.JobSpec(simulate=pb.SimulateJob(dataset="c")),
        pb.JobSpec(evaluate=pb.EvaluateJob(model="nobody:3", dataset="c")),
    ],
)
def test_a_job_that_cannot_be_is_refused(jobs: JobsServiceStub, spec: pb.JobSpec) -> None:
    with pytest.raises(grpc.RpcError) as refused:
        submit(jobs, "nightly", spec)
    assert refused.value.code() in (grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.NOT_FOUND)
    assert list(jobs.List(pb.ListRequest()).jobs) == []


def test_pages_are_walked_and_states_chosen(jobs: JobsServiceStub) -> None:
    for number in range(3):
        submit(jobs, f"job-{number}")
    jobs.Cancel(pb.CancelRequest(id="job-1"))
    first = jobs.List(pb.ListRequest(page_size=2))
    second = jobs.List(pb.ListRequest(page_size=2, page_token=first.next_page_token))
    assert [job.id for job in (*first.jobs, *second.jobs)] == ["job-2", "job-1", "job-0"]
    assert second.next_page_token == ""
    assert [job.id for job in jobs.List(pb.ListRequest(state=pb.JOB_STATE_CANCELLED)).jobs] == ["job-1"]
    for wrong in (pb.ListRequest(page_size=101), pb.ListRequest(state=9)):  # type: ignore[arg-type]
        with pytest.raises(grpc.RpcError) as refused:
            jobs.List(wrong)
        assert refused.value.code() == grpc.StatusCode.INVALID_ARGUMENT


def test_what_nobody_submitted_is_not_found(jobs: JobsServiceStub) -> None:
    for ask in (
        lambda: jobs.Get(pb.GetRequest(id="nobody\0")),
        lambda: jobs.Cancel(pb.CancelRequest(id="nobody")),
        lambda: jobs.Retry(pb.RetryRequest(id="nobody")),
        lambda: list(jobs.Watch(pb.WatchRequest(id="nobody"))),
    ):
        with pytest.raises(grpc.RpcError) as refused:
            ask()
        assert refused.value.code() == grpc.StatusCode.NOT_FOUND


def test_who_follows_a_job_is_told_everything_once_until_it_is_over(jobs: JobsServiceStub, queue: Jobs) -> None:
    submit(jobs, "nightly")
    queue.note("nightly", "first")
    coming = jobs.Watch(pb.WatchRequest(id="nightly"), timeout=30)
    told = [next(coming)]
    queue.note("nightly", "second")
    told.append(next(coming))
    jobs.Cancel(pb.CancelRequest(id="nightly"))
    told += list(coming)
    assert [line.line for each in told for line in each.lines] == ["first", "second", "cancelled"]
    assert [line.number for each in told for line in each.lines] == [1, 2, 3]
    assert told[-1].job.state == pb.JOB_STATE_CANCELLED
    again = list(jobs.Watch(pb.WatchRequest(id="nightly", after=2), timeout=30))
    assert [line.line for each in again for line in each.lines] == ["cancelled"]
    assert jobs.Retry(pb.RetryRequest(id="nightly")).job.state == pb.JOB_STATE_QUEUED


def test_those_who_follow_are_let_go_when_the_service_ends(jobs: JobsServiceStub, application: Application) -> None:
    submit(jobs, "nightly")
    threading.Timer(0.5, application.training.ending.set).start()
    with pytest.raises(grpc.RpcError) as ended:
        list(jobs.Watch(pb.WatchRequest(id="nightly"), timeout=30))
    assert ended.value.code() == grpc.StatusCode.UNAVAILABLE


def test_who_answers_or_trains_sees_jobs_and_only_who_trains_alters_them(
    start: Callable[..., Server], settings: Settings
) -> None:
    keys = KeyStore(settings.store)
    sent = {name: keys.create(name, (name,)).text for name in ("answer", "train", "manage")}
    time.sleep(1.1)  # the service believes what it read for a second
    application = Application(settings.model_copy(update={"access": "keys"}))
    with grpc.insecure_channel(start(application).address) as channel:
        jobs = JobsServiceStub(channel)

        def codes(call: Callable[..., object], request: object) -> dict[str, grpc.StatusCode]:
            found = {}
            for name, text in sent.items():
                try:
                    call(request, metadata=(("authorization", f"Bearer {text}"),), timeout=30)
                    found[name] = grpc.StatusCode.OK
                except grpc.RpcError as error:
                    found[name] = error.code()
            return found

        ok, refused = grpc.StatusCode.OK, grpc.StatusCode.PERMISSION_DENIED
        submitted = codes(jobs.Submit, pb.SubmitRequest(id="nightly", spec=TRAIN))
        assert submitted == {"answer": refused, "train": ok, "manage": refused}
        assert codes(jobs.Get, pb.GetRequest(id="nightly")) == {"answer": ok, "train": ok, "manage": refused}
        cancelled = codes(jobs.Cancel, pb.CancelRequest(id="nightly"))
        assert cancelled == {"answer": refused, "train": ok, "manage": refused}
    application.close()
