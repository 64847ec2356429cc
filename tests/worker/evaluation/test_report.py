"""A report is there whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from worker.evaluation.report import Data, Figures, JudgedModel, Matrices, Report, write_report

FIGURES = Figures(knn=0.5, svm=0.5, within=0.5, assigned=0.5)
REPORT = Report(
    command="none",
    model=JudgedModel(name="toys", version=1, sha256="0" * 64, concepts=2, responses=2, time=0.5),
    data=Data(
        labels="labels.csv", sha256="0" * 64, clouds=0, judged=0, groups=0, categories={}, not_judged={}, unanswered={}
    ),
    protocol={},
    figures=FIGURES,
    by_label={},
    by_source={},
    matrices=Matrices(labels=[], within=[], assigned=[]),
    grouping=None,
)


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    file = write_report(REPORT, tmp_path / "made" / "for it")
    assert Report.model_validate_json(file.read_text()) == REPORT


def test_an_older_report_stays_whole_when_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_report(REPORT, tmp_path)
    before = file.read_bytes()

    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_report(REPORT.model_copy(update={"command": "another"}), tmp_path)
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]
