"""The examples of what the API takes and tells of jobs; parameters are cut short where that is allowed."""

from __future__ import annotations

from typing import Any

from service.job import Job, JobError, Trained
from service.job_records import Progress
from service.job_specs import read_spec

SUBMISSIONS: dict[str, Any] = {
    "train": {
        "summary": "learn from two datasets and from simulated objects",
        "value": {"kind": "train", "name": "workshop", "datasets": ["scans", "more-scans"], "simulate": 250},
    },
    "evaluate": {
        "summary": "judge a model by the labels of a dataset",
        "value": {"kind": "evaluate", "model": "workshop@staging", "dataset": "test-scans"},
    },
    "simulate": {
        "summary": "simulate into a dataset",
        "value": {"kind": "simulate", "dataset": "toys", "count": 1000, "seed": 7},
    },
}
_QUEUED = Job(
    id="nightly-2025-01-31",
    state="queued",
    spec=read_spec({"name": "workshop", "datasets": ["scans"], "simulate": 250}),
    submitted="2025-01-31T02:00:00Z",
    started=None,
    finished=None,
    worker=None,
    result=None,
    error=None,
)
_RUNNING = _QUEUED.model_copy(
    update={
        "state": "running",
        "started": "2025-01-31T02:00:01Z",
        "worker": "gpu-box-2",
        "progress": Progress(
            stage="segments and descriptors", done=128, total=400, stages_done=1, stages=12, left_s=94.5
        ),
    }
)
_DONE = _RUNNING.model_copy(
    update={
        "state": "done",
        "finished": "2025-01-31T02:03:12Z",
        "progress": None,
        "result": Trained(model="workshop", version=4, parent="workshop:3", clouds=400, left_out=2),
    }
)
_FAILED = _RUNNING.model_copy(
    update={
        "id": "nightly-2025-01-30",
        "state": "failed",
        "finished": "2025-01-30T02:03:12Z",
        "error": JobError(type="not-enough-samples", detail="Learning needs at least 2 clouds that can be described."),
    }
)


def _said(job: Job) -> dict[str, Any]:
    return job.model_dump(mode="json", warnings=False)


QUEUED = _said(_QUEUED)
JOB = _said(_RUNNING)
JOBS: dict[str, Any] = {"jobs": [_said(_DONE), _said(_FAILED)], "next": None}
CANCELLED = _said(_QUEUED.model_copy(update={"state": "cancelled", "finished": "2025-01-31T02:00:30Z"}))
RETRIED = _said(_QUEUED)
EVENTS = (
    "retry: 1000\n\n"
    'event: log\nid: 1\ndata: {"number": 1, "at": "2025-01-31T02:00:01.2Z", "line": "taken by worker gpu-box-2"}\n\n'
    'event: job\ndata: {"id": "nightly-2025-01-31", "state": "running", ...}\n\n'
)
LOG: dict[str, Any] = {
    "job": "nightly-2025-01-31",
    "lines": [
        {"number": 1, "at": "2025-01-31T02:00:01.2Z", "line": "taken by worker gpu-box-2"},
        {"number": 2, "at": "2025-01-31T02:00:01.4Z", "line": "gathering clouds"},
    ],
}
