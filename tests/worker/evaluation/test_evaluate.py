"""The command `evaluate`, on simulated solids whose kind is their label."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from service.clouds import write_ply
from service.engine.params import ModelParams
from service.store import ModelStore
from worker.cli import main
from worker.evaluation.report import Report
from worker.learning.train import train
from worker.simulation import simulate
from worker.sources import Folder

COUNT = 42


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clouds of lone solids with their labels, a cloud that cannot be answered, and a model learnt from the clouds."""
    folder = tmp_path_factory.mktemp("solids")
    (folder / "clouds").mkdir()
    rows = ["file,category,source"]
    for o in simulate(COUNT, 11, orders=(1,), noise="none", renderer="raycast"):
        (folder / "clouds" / f"{o.index}.ply").write_bytes(write_ply(o.cloud))
        rows.append(f"clouds/{o.index}.ply,{o.composition.prototypes[0].kind},{'odd' if o.index % 2 else 'even'}")
    model = train(Folder(folder / "clouds"), ModelParams(), 1).model
    ModelStore(folder / "store").publish(model, name="solids", seed=1, source={"kind": "folder"})
    (folder / "empty.ply").write_bytes(b"")
    (folder / "labels.csv").write_text("\n".join([*rows, "empty.ply,box,odd"]) + "\n")
    return folder


def run(folder: Path, *arguments: str) -> Result:
    return CliRunner().invoke(main, ["evaluate", "--store", str(folder / "store"), "--workers", "1", *arguments])


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    chosen = ("--model", "solids", "--labels", str(folder / "labels.csv"), "--report", str(folder / "report"), "--json")
    return run(folder, *chosen)


@pytest.fixture(scope="module")
def report(result: Result) -> Report:
    assert result.exit_code == 0, result.output
    return Report.model_validate_json(result.stdout)


def test_what_is_printed_is_what_is_written(folder: Path, result: Result) -> None:
    assert json.loads((folder / "report" / "report.json").read_text()) == json.loads(result.stdout)
    assert [path.name for path in (folder / "report").iterdir()] == ["report.json"]


def test_a_cloud_that_cannot_be_answered_is_named_and_in_no_figure(report: Report, result: Result) -> None:
    assert set(report.data.unanswered) == {"empty.ply"}
    assert "Unanswered: empty.ply" in result.stderr
    assert report.data.clouds == COUNT + 1
    assert report.data.judged + sum(report.data.not_judged.values()) == COUNT


def test_figures_are_the_means_over_labels(report: Report) -> None:
    assert set(report.by_label) == set(report.data.categories) == set(report.matrices.labels)
    for name, value in report.figures.model_dump().items():
        assert value == pytest.approx(np.mean([getattr(figures, name) for figures in report.by_label.values()]))
    assert report.figures.within == pytest.approx(np.mean(np.diag(report.matrices.within)))
    assert report.figures.assigned == pytest.approx(np.mean(np.diag(report.matrices.assigned)))


def test_responses_tell_solids_apart_better_than_chance(report: Report) -> None:
    assert report.figures.knn > 1.3 / len(report.by_label)


def test_every_source_has_its_figures(report: Report) -> None:
    assert set(report.by_source) == {"odd", "even"}
    assert sum(figures.clouds for figures in report.by_source.values()) == report.data.judged


def test_concepts_of_labelled_prototypes_have_a_purity(report: Report) -> None:
    grouping = report.grouping
    assert grouping is not None
    assert grouping.prototypes == COUNT
    members = sum(concept.prototypes for concept in grouping.concepts)
    assert grouping.covered == pytest.approx(members / COUNT)
    assert grouping.purity == pytest.approx(np.mean([concept.purity for concept in grouping.concepts]))
    scores = [concept.rank_score for concept in grouping.concepts]
    assert scores == sorted(scores, reverse=True)


def test_a_report_says_how_it_was_made(report: Report, folder: Path) -> None:
    assert report.command.startswith("shape-concepts-worker evaluate --model solids --labels ")
    assert (report.model.name, report.model.version) == ("solids", 1)
    assert set(report.protocol) >= {"knn", "svm", "within", "assigned"}


def test_a_model_of_other_clouds_has_no_purity_to_tell(folder: Path, tmp_path: Path) -> None:
    store = ModelStore(folder / "store")
    for simulated in simulate(12, 5, renderer="raycast"):
        (tmp_path / f"{simulated.index}.ply").write_bytes(write_ply(simulated.cloud))
    model = train(Folder(tmp_path), ModelParams(), 1).model
    store.publish(model, name="others", seed=1, source={"kind": "folder"})
    labels = ("--labels", str(folder / "labels.csv"))
    told = run(folder, "--model", "others", *labels, "--report", str(tmp_path / "report"))
    assert told.exit_code == 0, told.output
    assert "purity cannot be told" in " ".join(told.stdout.split())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "No such file"),
        ("file,kind\n", "no column category"),
        ("file,category\n" + "".join(f"clouds/{i}.ply,box\n" for i in range(8)), "two categories"),
    ],
)
def test_labels_that_cannot_be_used_end_with_exit_code_1(folder: Path, text: str | None, told: str) -> None:
    table = folder / "wrong.csv"
    table.unlink(missing_ok=True)
    if text is not None:
        table.write_text(text)
    answer = run(folder, "--model", "solids", "--labels", str(table), "--report", str(folder / "none"))
    assert answer.exit_code == 1
    assert told in answer.stderr
    assert not (folder / "none").exists()
