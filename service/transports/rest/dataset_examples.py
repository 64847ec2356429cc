"""The examples of datasets in the API's description: a dataset with the example's cloud, as it is truly kept."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from typing import Any

from service.dataset_records import Dataset, DatasetSummary, Entry, Verdict, digest_of, refusal
from service.engine.errors import UnreadableCloud
from service.labels import Label, Labelled, write_labels
from service.transports.rest.examples import CLOUD_XYZ
from service.uploads import Upload

_NOW = datetime(2026, 11, 22, 12, 40, tzinfo=UTC)
_KEY = "kitchen/box-7.xyz"
_LABEL = Label(category="box", group="kitchen")
_ENTRY = Entry(
    key=_KEY,
    sha256=hashlib.sha256(CLOUD_XYZ.encode()).hexdigest(),
    bytes=len(CLOUD_XYZ),
    format="xyz",
    points=len(CLOUD_XYZ.splitlines()),
    added=_NOW,
    label=_LABEL,
)
_SUMMARY = DatasetSummary(name="mugs", description="mugs of the kitchen", created=_NOW)
_ACCEPTED = Verdict(key=_KEY, outcome="accepted", sha256=_ENTRY.sha256)
_REFUSED = refusal(
    "kitchen/torn.ply", UnreadableCloud("PLY: the header has no end_header; the file is truncated: send it again")
)
_UPLOAD = Upload(id="5f0c2b0d9a4e4f8c8f4b8f1f3a1d2e3c", dataset="mugs", key=None, length=2**30, created=_NOW)


def _told(record: Any) -> dict[str, Any]:
    found: dict[str, Any] = record.model_dump(mode="json")
    return found


SUMMARY = _told(_SUMMARY)
DATASETS = {"datasets": [SUMMARY]}
DATASET = _told(
    Dataset(
        **_SUMMARY.model_dump(),
        clouds=1,
        bytes=_ENTRY.bytes,
        formats={"xyz": 1},
        categories={"box": 1},
        digest=digest_of([_ENTRY]),
    )
)
CLOUDS = {"dataset": "mugs", "clouds": [_told(_ENTRY)], "after": None}
VERDICT = _told(_ACCEPTED)
ADDED = {
    "dataset": "mugs",
    "outcomes": {"accepted": 1, "refused": 1},
    "verdicts": [VERDICT, _told(_REFUSED)],
}
LABELS = write_labels([Labelled(_KEY, _LABEL)]).decode()
LABELS_TAKEN = {"labelled": 1, "unknown": 0, "first_unknown": []}
UPLOAD = _told(_UPLOAD)
UPLOAD_UNDER_WAY = UPLOAD | {"offset": 2**23}
