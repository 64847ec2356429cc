"""How well responses tell real scans apart, choice by choice: models that differ in one choice, of several seeds.

Trained on simulated objects alone; the labels judge. One choice at a time is changed back, and each arm is judged over
all seeds, so that what is kept is kept for a figure and not for one lucky draw.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, parallel_config
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.engine.perception import Perception, perceive
from service.engine.stimuli import stimulate
from tests.conftest import data_folder
from worker.evaluation import bootstrap
from worker.evaluation.judgement import Recalled, judge_others
from worker.evaluation.labels import judged, read_labels
from worker.evaluation.protocols import Samples, nearest_neighbour, support_vectors
from worker.evaluation.regions import MAPS, draw_response_map, region_matrices
from worker.learning.observations import NamedCloud, Observation, observe
from worker.learning.train import learn
from worker.simulation import SimulationParams, simulate

JUDGE, OTHER = "scans", "occluded"
DEFAULT = "default"

ARMS: dict[str, dict[str, dict[str, Any]]] = {
    DEFAULT: {},
    "the whole object alone": {"stimuli": {"segment_weight": 0, "union_weight": 0}},
    "segments alone": {"stimuli": {"whole_weight": 0, "union_weight": 0}},
    "unions alone": {"stimuli": {"segment_weight": 0, "union_weight": 1, "whole_weight": 0}},
    "unions beside": {"stimuli": {"union_weight": 1}},
    "any constellation excites any vertex": {"stimuli": {"gating": "kernel", "pooling": "max", "balanced": False}},
    "sigma 0.05": {"stimuli": {"sigma": 0.05}},
    "coverage not squared": {"stimuli": {"coverage_power": 1}},
    "4 levels of words": {"dictionary": {"levels": 4}},
    "8 levels of words": {"dictionary": {"levels": 8}},
    "32 dimensions": {"response": {"dimensions": 32}},
    "Hellinger": {"response": {"power": 0.5}},
    "epsilon_max alone": {"response": {"scales": 1}},
    "5 scales": {"response": {"scales": 5}},
    "epsilon_max of single steps": {"filtration": {"window": 0}},
    "FPFH alone": {"descriptor": {"shape_weight": 0}},
    "preset paper": {},
}
MAPPED = (DEFAULT, "the whole object alone", "preset paper")  # maps take most of the time


class Figures(NamedTuple):
    """What the protocols tell of one model.

    Attributes:
        recalled: of each set, judged by itself, or, the last one, by `scans`.
        regions: of each set but the last, `within` and `assigned`; NaN where no map was drawn.
    """

    recalled: dict[str, Recalled]
    regions: dict[str, tuple[float, float]]


class Vectors(NamedTuple):
    """Responses of a set's clouds, and what is known of them."""

    vectors: NDArray[np.float64]
    categories: NDArray[np.str_]
    groups: NDArray[np.str_]
    judged: NDArray[np.int64]

    def samples(self, rows: NDArray[Any]) -> Samples:
        """Some of them."""
        return Samples(self.vectors[rows], self.categories[rows], self.groups[rows])


def main(arguments: list[str]) -> None:
    """Prints a table of the arms asked for."""
    parser = argparse.ArgumentParser(prog="./run bench quality", description=__doc__)
    parser.add_argument("--objects", type=int, default=250, help="simulated objects a model (250)")
    parser.add_argument("--seeds", default="1-5", help="training seeds, first-last (1-5)")
    parser.add_argument("--arms", nargs="*", default=list(ARMS), choices=list(ARMS), metavar="ARM", help="all of them")
    asked = parser.parse_args(arguments)
    first, _, last = asked.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    print(f"{asked.objects} simulated objects, seeds {asked.seeds}: mean (standard deviation over the seeds)")
    print(f"{'':38}{'scans: knn':>15}{'svm':>15}{'within':>15}{'assigned':>15}", end="")
    print(f"{'rendered: knn':>15}{'svm':>15}{'within':>15}{'assigned':>15}{'occluded: knn':>15}{'svm':>15}")
    default: list[Figures] = []
    for arm in dict.fromkeys([DEFAULT, *asked.arms]):
        figures = [judge_arm(arm, seed, asked.objects) for seed in seeds]
        default = default or figures
        print(f"{arm:38}" + "".join(f"{mean:8.3f}({spread:.3f})" for mean, spread in _columns(figures)))
        if arm != DEFAULT:
            for line in _differences(default, figures):
                print(f"    default is ahead by: {line}", flush=True)


def judge_arm(arm: str, seed: int, objects: int) -> Figures:
    """Learns a model and judges its responses."""
    preset = "paper" if arm == "preset paper" else DEFAULT
    stages = ModelParams.preset(preset).model_dump()
    changed = {stage: stages[stage] | values for stage, values in ARMS[arm].items()}
    params = ModelParams.model_validate(stages | changed)
    with parallel_config(backend="loky", n_jobs=2):
        model = learn(_objects(seed, objects, preset, _seen_by(params)), params, seed)
        sets = {name: _respond(model, name) for name in (JUDGE, "rendered", OTHER)}
    return _judge(sets, maps=MAPS if arm in MAPPED else 0)


def _seen_by(params: ModelParams) -> ModelParams:
    """The parameters of perception, over defaults: what objects are seen with is the same for many arms."""
    stages = ("cloud", "patches", "segments", "descriptor", "hierarchy")
    return ModelParams().model_copy(update={stage: getattr(params, stage) for stage in stages})


@lru_cache(maxsize=16)
def _objects(seed: int, count: int, preset: str, params: ModelParams) -> list[Observation]:
    simulated = simulate(count, seed, params=SimulationParams.preset(preset))
    named = (NamedCloud(str(each.index), each.cloud) for each in simulated)
    return [each for each in observe(named, params) if isinstance(each, Observation)]


@lru_cache(maxsize=8)
def _perceived(name: str, params: ModelParams) -> list[Perception]:
    table = _table(name)
    files = [table.parent / row.file for row in read_labels(table)]
    return list(Parallel()(delayed(_perceive)(file, params) for file in files))


def _perceive(file: Path, params: ModelParams) -> Perception:
    with threadpool_limits(1):
        return perceive(clouds.read(file.read_bytes()), params)


def _respond(model: ShapeModel, name: str) -> Vectors:
    rows = read_labels(_table(name))
    seen = _perceived(name, _seen_by(model.params))
    return Vectors(
        np.stack([_responses(model, each) for each in seen]),
        np.array([row.category for row in rows]),
        np.array([row.group for row in rows]),
        np.array(judged(rows)),
    )


def _responses(model: ShapeModel, seen: Perception) -> NDArray[np.float64]:
    """What `ShapeModel.respond` answers for an object that was perceived already."""
    words = model.dictionary.words(seen.segment_descriptors)
    stimuli = stimulate(model.ensemble, seen.constellations, seen.descriptors, words, model.params.stimuli)
    return model.compare(stimuli, model.spectrum()).responses


def _judge(sets: dict[str, Vectors], maps: int) -> Figures:
    with threadpool_limits(1):  # as the evaluation does
        return _judge_alone(sets, maps)


def _judge_alone(sets: dict[str, Vectors], maps: int) -> Figures:
    recalled, regions = {}, {}
    for name in (JUDGE, "rendered"):
        samples = sets[name].samples(sets[name].judged)
        recalled[name] = Recalled(samples.labels, samples.groups, nearest_neighbour(samples), support_vectors(samples))
        regions[name] = (np.nan, np.nan)
        if maps:
            points = [draw_response_map(samples.vectors, seed) for seed in range(maps)]
            matrices = region_matrices(points, samples.labels)
            regions[name] = (float(np.diag(matrices.within).mean()), float(np.diag(matrices.assigned).mean()))
    judges = sets[JUDGE].samples(sets[JUDGE].judged)
    known = np.isin(sets[OTHER].categories, np.unique(judges.labels))
    recalled[OTHER] = judge_others(judges, sets[OTHER].samples(known))
    return Figures(recalled, regions)


def _columns(figures: list[Figures]) -> Iterable[tuple[float, float]]:
    """Mean and standard deviation over the seeds of each figure."""
    rows = []
    for each in figures:
        row: list[float] = []
        for name, recalled in each.recalled.items():
            labels = recalled.by_label().values()
            row += [float(np.mean([label[kind] for label in labels])) for kind in ("knn", "svm")]
            row += each.regions.get(name, ())
        rows.append(row)
    return zip(np.mean(rows, axis=0).tolist(), np.std(rows, axis=0).tolist(), strict=True)


def _differences(first: list[Figures], second: list[Figures]) -> Iterable[str]:
    """How far the first arm is ahead, over all seeds, with intervals over groups."""
    for name, recalled in first[0].recalled.items():
        for kind, rows in (("knn", "nearest"), ("svm", "machines")):
            one, other = (np.vstack([getattr(each.recalled[name], rows) for each in arm]) for arm in (first, second))
            value, low, high = bootstrap.difference(recalled.labels, recalled.groups, one, other)
            yield f"{name} {kind} {value:+.3f} [{low:+.3f}, {high:+.3f}]"


def _table(name: str) -> Path:
    table = data_folder() / name / "labels.csv"
    if not table.exists():
        raise SystemExit(f"There is no {table}: set SHAPE_CONCEPTS_DATA to the folder of labelled scans.")
    return table
