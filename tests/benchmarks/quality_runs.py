"""One model of the quality study: learnt from simulated objects alone, judged by the real scans."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.concepts import rank_concepts
from service.engine.errors import ShapeConceptsError
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.engine.perception import Perception, perceive
from tests.benchmarks.quality_arms import Arm
from tests.conftest import data_folder
from worker.evaluation.ablation import arms_of, even, respond_by, restrict, stimuli_of, tells_apart
from worker.evaluation.baselines import see_whole
from worker.evaluation.judgement import Recalled, judge_others, judge_recalls
from worker.evaluation.labels import judged, read_labels
from worker.evaluation.protocols import Samples
from worker.evaluation.regions import MAPS, draw_response_map, region_matrices
from worker.evaluation.report import Robustness
from worker.evaluation.robustness import REFUSED, curves, disturbed
from worker.learning.observations import NamedCloud, Observation, observe
from worker.learning.train import learn
from worker.simulation import SimulationParams, simulate

JUDGE, RENDERED, OTHER = "scans", "rendered", "occluded"
SETS = (JUDGE, RENDERED, OTHER)


class Figures(NamedTuple):
    """What the protocols tell of one model.

    Attributes:
        recalled: of each set, judged by itself, or, the last one, by `scans`.
        regions: of each set but the last, `within` and `assigned`; NaN where no map was drawn.
    """

    recalled: dict[str, Recalled]
    regions: dict[str, tuple[float, float]]


class Seen(NamedTuple):
    """A set's clouds as the method sees them, and what is known of them."""

    perceptions: list[Perception]
    categories: NDArray[np.str_]
    groups: NDArray[np.str_]
    judged: NDArray[np.int64]

    def samples(self, vectors: NDArray[np.float64], rows: NDArray[np.int64]) -> Samples:
        """Some of them, with all their vectors."""
        return Samples(vectors[rows], self.categories[rows], self.groups[rows])


def judge_arm(arm: Arm, seeds: Sequence[int], count: int, maps: bool) -> list[Figures]:
    """Learns a model a seed and judges its responses."""
    sets = {name: see_set(name, _perception(arm.params)) for name in SETS}
    return _over_seeds(_judge_model, arm, seeds, count, sets, maps)


def judge_levels(arm: Arm, seeds: Sequence[int], count: int) -> list[dict[str, Figures]]:
    """Learns a model a seed and judges what is left of it when motif levels are taken away."""
    sets = {name: see_set(name, _perception(arm.params)) for name in SETS}
    return _over_seeds(_judge_levels, arm, seeds, count, sets)


def judge_robustness(arm: Arm, seeds: Sequence[int], count: int) -> list[Robustness]:
    """Learns a model a seed and disturbs the clouds of `scans`."""
    seen = _see_disturbed(_perception(arm.params))
    return _over_seeds(_judge_robustness, arm, seeds, count, seen)


def _over_seeds(judge, arm, seeds, count, *arguments):  # type: ignore[no-untyped-def] # as `judge`
    objects = [see_objects(seed, count, arm.simulation, _perception(arm.params)) for seed in seeds]
    calls = (delayed(judge)(arm, seed, of, *arguments) for seed, of in zip(seeds, objects, strict=True))
    return Parallel()(calls)


def _perception(params: ModelParams) -> ModelParams:
    """The parameters of perception, over defaults: what objects are seen with is the same for many arms."""
    stages = ("cloud", "patches", "segments", "descriptor", "hierarchy")
    return ModelParams().model_copy(update={stage: getattr(params, stage) for stage in stages})


@lru_cache(maxsize=12)
def see_objects(seed: int, count: int, simulation: SimulationParams, params: ModelParams) -> list[Observation]:
    """Simulated objects."""
    named = (NamedCloud(str(each.index), each.cloud) for each in simulate(count, seed, params=simulation))
    return [each for each in observe(named, params) if isinstance(each, Observation)]


@lru_cache(maxsize=6)
def see_set(name: str, params: ModelParams) -> Seen:
    """The clouds of a labelled set."""
    table = _table(name)
    rows = read_labels(table)
    seen = Parallel()(delayed(_perceive)(table.parent / row.file, params) for row in rows)
    return Seen(
        list(seen),
        np.array([row.category for row in rows]),
        np.array([row.group for row in rows]),
        np.array(judged(rows)),
    )


def _perceive(file: Path, params: ModelParams) -> Perception:
    with threadpool_limits(1):
        return perceive(clouds.read(file.read_bytes()), params)


@lru_cache(maxsize=2)
def _see_disturbed(params: ModelParams) -> list[list[Perception | None]]:
    table = _table(JUDGE)
    files = [table.parent / row.file for row in read_labels(table)]
    return list(Parallel()(delayed(_disturb)(file, params) for file in files))


def _disturb(file: Path, params: ModelParams) -> list[Perception | None]:
    """A cloud as it is, and under each disturbance; None where it is refused."""
    cloud = clouds.read(file.read_bytes())
    digest = hashlib.sha256(np.ascontiguousarray(cloud.points).tobytes()).hexdigest()
    seen: list[Perception | None] = []
    with threadpool_limits(1):
        for each in (cloud, *disturbed(cloud, see_whole(cloud, params.cloud), digest)):
            try:
                seen.append(perceive(each, params))
            except ShapeConceptsError:
                seen.append(None)
    return seen


def _judge_model(arm: Arm, seed: int, objects: list[Observation], sets: dict[str, Seen], maps: bool) -> Figures:
    with threadpool_limits(1):
        model = learn(objects, arm.params, seed)
        spectrum = model.spectrum()
        stimuli = {name: stimuli_of(model, seen.perceptions) for name, seen in sets.items()}
        vectors = {
            name: np.stack([model.compare(each, spectrum).responses for each in of]) for name, of in stimuli.items()
        }
        return _judge(sets, vectors, MAPS if maps else 0)


def _judge_levels(arm: Arm, seed: int, objects: list[Observation], sets: dict[str, Seen]) -> dict[str, Figures]:
    with threadpool_limits(1):
        model = even(learn(objects, arm.params, seed))
        stimuli = {name: stimuli_of(model, seen.perceptions) for name, seen in sets.items()}
        figures = {}
        for left in arms_of(model.ensemble, model.params.hierarchy.whole_apart):
            if restricted := restrict(model, left):
                vectors = {name: respond_by(restricted, left, of) for name, of in stimuli.items()}
                if tells_apart(vectors[JUDGE]):
                    figures[left.name] = _judge(sets, vectors, maps=0)
        return figures


def _judge_robustness(
    arm: Arm, seed: int, objects: list[Observation], seen: list[list[Perception | None]]
) -> Robustness:
    with threadpool_limits(1):
        model = learn(objects, arm.params, seed)
        best = np.array([[_best(model, each) for each in of_cloud] for of_cloud in seen])
        return curves(best[:, 0], list(best[:, 1:]))


def _best(model: ShapeModel, seen: Perception | None) -> int:
    """The id of the best concept."""
    if seen is None:
        return REFUSED
    spectrum = model.spectrum()
    (stimuli,) = stimuli_of(model, [seen])
    return int(spectrum.ids[rank_concepts(model.compare(stimuli, spectrum).responses, spectrum)[0]])


def _judge(sets: dict[str, Seen], vectors: dict[str, NDArray[np.float64]], maps: int) -> Figures:
    recalled, regions = {}, {}
    for name in (JUDGE, RENDERED):
        samples = sets[name].samples(vectors[name], sets[name].judged)
        recalled[name], regions[name] = judge_recalls(samples), (np.nan, np.nan)
        if maps:
            points = [draw_response_map(samples.vectors, seed) for seed in range(maps)]
            matrices = region_matrices(points, samples.labels)
            regions[name] = (float(np.diag(matrices.within).mean()), float(np.diag(matrices.assigned).mean()))
    judges = sets[JUDGE].samples(vectors[JUDGE], sets[JUDGE].judged)
    known = np.flatnonzero(np.isin(sets[OTHER].categories, np.unique(judges.labels)))
    recalled[OTHER] = judge_others(judges, sets[OTHER].samples(vectors[OTHER], known))
    return Figures(recalled, regions)


def _table(name: str) -> Path:
    table = data_folder() / name / "labels.csv"
    if not table.exists():
        raise SystemExit(f"There is no {table}: set SHAPE_CONCEPTS_DATA to the folder of labelled scans.")
    return table
