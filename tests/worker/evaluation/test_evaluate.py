"""The command `evaluate`, on simulated solids whose kind is their label."""

from __future__ import annotations

import json
from collections import Counter
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
    """Clouds of lone solids with their labels, a cloud that cannot be answered, and a model learnt from the clouds.

    Others are a few of the clouds with groups of their own; `kinds.csv` has vectors that give the label away.
    """
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
    few = [row.split(",")[:2] for row in rows[1:15]]
    others = [f"{file},{kind},other {file}" for file, kind in few]
    (folder / "others.csv").write_text("\n".join(["file,category,group", *others, "empty.ply,box,none"]) + "\n")
    kinds = [f"/pcd/{Path(row).stem}.pcd,{row.count('box')},{row.count('sphere')}" for row in rows[1:]]
    (folder / "foreign.csv").write_text("mug.pcd,1,2\n")
    (folder / "kinds.csv").write_text("\n".join(kinds) + "\n")
    return folder


def run(folder: Path, *arguments: str) -> Result:
    return CliRunner().invoke(main, ["evaluate", "--store", str(folder / "store"), "--workers", "1", *arguments])


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    chosen = ["--model", "solids", "--labels", str(folder / "labels.csv"), "--report", str(folder / "report"), "--json"]
    chosen += ["--other", str(folder / "others.csv"), "--baseline", f"kind={folder / 'kinds.csv'}"]
    return run(folder, *chosen)


@pytest.fixture(scope="module")
def report(result: Result) -> Report:
    assert result.exit_code == 0, result.output
    return Report.model_validate_json(result.stdout)


def test_what_is_printed_is_what_is_written(folder: Path, result: Result) -> None:
    assert json.loads((folder / "report" / "report.json").read_text()) == json.loads(result.stdout)
    assert {path.name for path in (folder / "report").iterdir()} == {"report.json", "report.html"}


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


def test_baselines_are_judged_beside_the_model(report: Report) -> None:
    assert list(report.baselines) == ["mean FPFH", "shape distributions", "ESF", "kind"]
    assert report.intervals is not None
    for baseline in report.baselines.values():
        assert set(baseline.by_label) == set(report.by_label)
        for name in ("knn", "svm"):
            value = getattr(baseline.intervals, name).value
            assert value == pytest.approx(getattr(baseline.figures, name))
            ahead = getattr(report.intervals, name).value - value
            assert getattr(baseline.ahead, name).value == pytest.approx(ahead)


def test_vectors_that_give_the_label_away_are_told_to(report: Report) -> None:
    kind = report.baselines["kind"]
    assert kind.dimensions == 2
    assert (kind.figures.knn, kind.figures.svm) == (1, 1)
    assert kind.ahead.knn.high <= 0


def test_every_judged_cloud_has_its_place_in_the_map(report: Report) -> None:
    assert report.map is not None
    assert len(report.map.places) == report.data.judged
    assert Counter(place.label for place in report.map.places) == report.data.categories
    grid = report.map.regions
    assert np.shape(grid.cells) == np.shape(grid.opacity) == (60, 60)
    xs = [place.x for place in report.map.places]
    assert (min(xs), max(xs)) == (grid.low[0], grid.high[0])


def test_the_structure_of_the_model_bears_the_labels(report: Report) -> None:
    structure = report.structure
    assert structure is not None
    assert len(structure.edges) == COUNT - 1
    assert Counter(structure.labels) == Counter(report.data.categories) + Counter(report.data.not_judged)
    assert report.grouping is not None
    named = {concept.id: concept.labels for concept in report.grouping.concepts}
    for place, concept in enumerate(structure.concepts):
        members = [x for x, of in zip(structure.labels, structure.assignment, strict=True) if of == place]
        assert named[concept] == Counter(members)


def test_clusterings_of_the_same_prototypes_are_judged_beside_the_concepts(report: Report) -> None:
    assert report.grouping is not None
    assert report.grouping.figures is not None
    kmeans = [rival for rival in report.grouping.rivals if rival.method == "k-means"]
    assert {rival.vectors for rival in kmeans} >= {"mean FPFH", "shape distributions", "ESF"}
    assert {rival.figures.groups for rival in kmeans} == {report.grouping.figures.groups}


def test_another_set_is_judged_by_the_first(report: Report) -> None:
    (other,) = report.others
    assert other.data.unanswered.keys() == {"empty.ply"}
    assert other.data.judged == 14
    assert other.model.intervals.knn.value == 1  # each of its clouds is in the first set, under another group
    assert set(other.baselines) == set(report.baselines)
    assert all(baseline.ahead is not None for baseline in other.baselines.values())


def test_every_motif_level_is_judged_alone_and_every_rank_is_left_out_once(report: Report) -> None:
    arms = {arm.name: arm for arm in report.ablation}
    assert set(arms) >= {"single segments alone", "the whole object alone", "unions alone"}
    assert set(arms) >= {"all but single segments", "all but unions", "all but the whole object"}
    alone, others = arms["the whole object alone"], arms["all but the whole object"]
    assert not set(alone.levels) & set(others.levels)
    for arm in arms.values():
        assert len(arm.sets) == 1 + len(report.others)
        for found, whole in zip(arm.sets, (report.intervals, report.others[0].model.intervals), strict=True):
            assert whole is not None
            lead = whole.knn.value - found.intervals.knn.value
            assert found.ahead.knn.value == pytest.approx(lead)


def test_one_instance_a_label_is_tried_with_the_responses_and_every_baseline(report: Report) -> None:
    assert report.transfer is not None
    assert set(report.transfer.rivals) == {"responses", *report.baselines}
    assert report.transfer.recall.mean > 1.2 / len(report.by_label)


def test_a_report_says_how_it_was_made(report: Report, folder: Path) -> None:
    assert report.command.startswith("shape-concepts-worker evaluate --model solids --labels ")
    assert (report.model.name, report.model.version) == ("solids", 1)
    assert set(report.protocol) >= {"knn", "svm", "within", "assigned", "intervals", "transfer", "rivals", "others"}
    assert "--other" in report.command
    assert report.robustness is None


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


@pytest.fixture(scope="module")
def few(folder: Path) -> Path:
    """Labels of few clouds, which are answered in no time."""
    rows = (folder / "labels.csv").read_text().splitlines()
    kinds = [[row for row in rows if f",{kind}," in row and "empty" not in row][:6] for kind in ("box", "sphere")]
    (folder / "few.csv").write_text("\n".join([rows[0], *kinds[0], *kinds[1]]) + "\n")
    return folder / "few.csv"


def test_robustness_is_told_where_it_is_asked_for(folder: Path, few: Path) -> None:
    chosen = ("--model", "solids", "--labels", str(few), "--report", str(folder / "robust"), "--robustness", "--json")
    robustness = Report.model_validate_json(run(folder, *chosen).stdout).robustness
    assert robustness is not None
    assert robustness.clouds == 12
    rescaled = next(curve for curve in robustness.curves if curve.name == "rescaled")
    assert min(at.kept for at in rescaled.strengths) > 0.8


@pytest.mark.slow
def test_the_report_is_the_same_on_any_number_of_workers(folder: Path, few: Path) -> None:
    chosen = ("--model", "solids", "--labels", str(few), "--report", str(folder / "same"), "--robustness", "--json")
    alone, shared = run(folder, *chosen), run(folder, *chosen, "--workers", "2")
    assert shared.exit_code == 0, shared.output
    assert shared.stdout == alone.stdout


@pytest.mark.parametrize(
    ("baseline", "code", "told"),
    [
        ("kinds.csv", 2, "is no NAME=FILE"),
        ("kind=lost.csv", 1, "No such file"),
        ("ESF=kinds.csv", 1, "'ESF' need another name"),
        ("others=others.csv", 1, "no number"),
        ("foreign=foreign.csv", 1, "lack 43 of the 43 clouds"),
    ],
)
def test_vectors_that_cannot_be_used_are_told(folder: Path, baseline: str, code: int, told: str) -> None:
    name, _, file = baseline.rpartition("=")
    given = f"{name}={folder / file}" if name else baseline
    labels = ("--labels", str(folder / "labels.csv"))
    answer = run(folder, "--model", "solids", *labels, "--report", str(folder / "none"), "--baseline", given)
    assert answer.exit_code == code
    assert told in " ".join(answer.stderr.split())


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
