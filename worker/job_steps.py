"""What the steps of jobs do: gather clouds, learn, judge, publish; evaluate; simulate.

Each may be killed at any moment and is then done again from its beginning, to the same effect. Each is called in a
process of its own, with what it tells of itself first.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from joblib import parallel_config

from service.carrying import carry_from_earlier
from service.clouds import write_ply
from service.datasets import Datasets
from service.engine.errors import InvalidParameter
from service.engine.model import ShapeModel
from service.job_specs import EvaluateSpec, SimulateSpec, TrainSpec
from service.labels import FILE, Label, Labelled, write_labels
from service.model_file import Manifest
from service.objects import Objects
from service.store import ModelStore
from worker.earlier import earlier_sources, join
from worker.evaluation.answering import answer
from worker.evaluation.evaluate import Request, evaluate
from worker.evaluation.judging import figures_of
from worker.evaluation.labels import judged_categories, read_labels
from worker.evaluation.page import write_page
from worker.evaluation.promotion import Rule
from worker.evaluation.report import Report, write_report
from worker.job_files import JobFiles, as_npy
from worker.learning.train import train
from worker.promoting import Outcome, promote_by_rule
from worker.sharing import shared_out
from worker.simulation import simulate
from worker.simulation.params import SimulationParams
from worker.sources import Dataset, Folder, Joined, Simulation, Source

REPORTS = "reports"
JUDGING_BOTH = "judging both versions"
NAMED = 100  # clouds that were left out, by name in the log
STAGES: dict[str, dict[str, float]] = {
    "train": {
        "gathering clouds": 0.35,
        "segments and descriptors": 0.30,
        "dictionary": 0.03,
        "motif hierarchies": 0.05,
        "stimuli": 0.10,
        "topological space": 0.02,
        "filtration": 0.01,
        "concepts": 0.01,
        "metric": 0.02,
        "novelty": 0.03,
        "map": 0.06,
        "publishing": 0.01,
        "carrying names over": 0.01,
    },
    "judge": {"gathering labelled clouds": 0.1, "responses": 0.6, "figures": 0.3},
    "evaluate": {
        "gathering labelled clouds": 0.05,
        "labels": 0.01,
        "responses": 0.40,
        "figures": 0.24,
        "other sets": 0.01,
        "motif levels": 0.10,
        "grouping": 0.02,
        "one instance a label": 0.12,
        "report": 0.05,
    },
    "simulate": {"simulating": 1.0},
}
"""The stages of each kind of job, in order, and their shares of its time: for the estimate of the time left."""


class Tell(Protocol):
    """What a step tells of itself."""

    def stage(self, name: str, total: int | None = None) -> None:
        """A stage begins."""

    def count(self, items: Iterable[Any], total: int) -> Iterator[Any]:
        """Hands items on and counts them."""

    def log(self, line: str) -> None:
        """A line for the job's log."""


class Place(NamedTuple):
    """Where a step works.

    Attributes:
        store: URL.
        job: its id.
        processes: that it may use.
        cluster: address of the Dask cluster that describes and simulates in their stead, if one does.
    """

    store: str
    job: str
    processes: int
    cluster: str | None = None

    @property
    def files(self) -> JobFiles:
        """What the job has kept."""
        return JobFiles(Objects(self.store), self.job)


def stages_of(spec: TrainSpec | EvaluateSpec | SimulateSpec) -> dict[str, float]:
    """The stages of a job, in order, and their shares of its time."""
    stages = dict(STAGES[spec.kind])
    if spec.kind == "train" and spec.labelled is not None:
        last = [stages.popitem() for _ in range(2)]
        stages |= {stage: share / 4 for stage, share in STAGES["judge"].items()}
        stages |= dict(reversed(last))
    if spec.kind == "train" and spec.promote == "not-worse":
        stages |= {JUDGING_BOTH: 0.25}
    whole = sum(stages.values())
    return {stage: share / whole for stage, share in stages.items()}


def gather(tell: Tell, spec: TrainSpec, place: Place) -> int:
    """Simulates the training clouds, or reads them, and keeps them.

    Returns:
        How many there are.

    Raises:
        InvalidParameter: there is no cloud, a parameter of the simulation is out of its range, or too few clouds have
            labels to judge by: better told now than after the learning.
        DatasetNotFound: a dataset is not there, that of the judge among them.
        RendererUnavailable: SAPIEN cannot render here.
    """
    tell.stage("gathering clouds")
    if spec.labelled is not None:
        judged_categories(label.category for label in _labels(Dataset(Datasets(place.store), spec.labelled)).values())
    before = spec.extend or spec.parent
    parent = before and "{}:{}".format(*ModelStore(place.store).resolve(before))
    source, files, keys = _source(tell, spec, place, parent), place.files, []
    with shared_out(place.processes, place.cluster):
        for number, named in enumerate(tell.count(source, source.count)):
            files.write_cloud(number, named.cloud)
            keys.append(named.key)
    refused = {key: str(error) for key, error in source.refused}
    files.write_index({"keys": keys, "source": source.describe(), "parent": parent, "refused": refused})
    return len(keys)


def learn(tell: Tell, spec: TrainSpec, place: Place) -> dict[str, int]:
    """Learns a model from the clouds and keeps it.

    Returns:
        How many clouds there are, and how many were left out.

    Raises:
        NotEnoughSamples: fewer than two clouds can be described.
    """
    files = place.files
    index = files.index()
    with shared_out(place.processes, place.cluster):
        model, refused = train(tell.count(files.clouds(), len(index["keys"])), spec.params, spec.seed, tell.stage)
    files.write_model(model)
    left_out = index["refused"] | {key: str(error) for key, error in refused}
    for key, why in list(left_out.items())[:NAMED]:
        tell.log(f"left out {key}: {why}")
    if len(left_out) > NAMED:
        tell.log(f"left out {len(left_out) - NAMED} more")
    return {"clouds": len(index["keys"]), "left_out": len(left_out)}


def judge(tell: Tell, spec: TrainSpec, place: Place) -> dict[str, float]:
    """Judges the model that was learnt, before it is published; returns its figures.

    Raises:
        InvalidParameter: too few clouds have labels to judge by.
    """
    assert spec.labelled is not None
    model = place.files.model(spec.params)
    with _labelled(tell, place, spec.labelled) as table, parallel_config(backend="loky", n_jobs=place.processes):
        tell.stage("responses")
        answered = answer(model, table, read_labels(table), False, tell.count)
        tell.stage("figures")
        return figures_of(answered)


def publish(
    tell: Tell, spec: TrainSpec, place: Place, metrics: dict[str, float] | None, once: str
) -> dict[str, int | str | None]:
    """Publishes the model once, however often it is called.

    Args:
        tell: of itself.
        spec: of the job.
        place: where to.
        metrics: figures of the model.
        once: what no other job has, not even an earlier one of the same id.

    Returns:
        The version and its parent.
    """
    tell.stage("publishing")
    files = place.files
    index = files.index()
    made: dict[str, Any] = {"name": spec.name, "seed": spec.seed, "source": index["source"], "parent": index["parent"]}
    model, store = files.model(spec.params), ModelStore(place.store)
    manifest = store.publish(model, alias=None, metrics=metrics, job=place.job, once=once, **made)
    tell.log(f"published {spec.name}:{manifest.version}")
    return {"version": manifest.version, "parent": manifest.parent}


def promote(tell: Tell, spec: TrainSpec, place: Place, version: int, parent: str | None) -> dict[str, Any]:
    """Carries names over to the version that was published, and lets the alias mean it, as the rule says.

    Names come from the parent, or where there is none from the version that the alias means, or else the last one.

    Args:
        tell: of itself.
        spec: of the job.
        place: where to.
        version: that was published.
        parent: NAME:VERSION of the model that it follows.

    Returns:
        Of `Trained`: how many names were carried over, whether it was promoted, and why.
    """
    store, alias = ModelStore(place.store), spec.alias
    before = None if alias is None else store.aliases(spec.name).get(alias)
    tell.stage("carrying names over")
    before_it = max((each for each in store.versions(spec.name) if each < version), default=None)
    earlier = parent or (f"{spec.name}:{before or before_it}" if before or before_it else None)
    carried = carry_from_earlier(store, earlier, (spec.name, version))
    for each in carried:
        tell.log(f"concept {each.concept} is called {each.name}, as concept {each.before} of {earlier}")
    told: dict[str, Any] = {"names_carried": len(carried), "promoted": False, "reasons": []}
    if alias is None or spec.promote == "never":
        return told
    if spec.promote == "always":
        store.promote(spec.name, version, alias, only_forward=True)
        return told | {"promoted": store.aliases(spec.name)[alias] == version}
    outcome = _promote_by_rule(tell, spec, place, version, alias)
    for reason in outcome.reasons:
        tell.log(reason)
    tell.log(outcome.sentence())
    return told | {"promoted": outcome.promoted, "reasons": outcome.reasons}


def _promote_by_rule(tell: Tell, spec: TrainSpec, place: Place, version: int, alias: str) -> Outcome:
    assert spec.labelled is not None
    rule, which = Rule(tolerance=spec.tolerance), f"{spec.name}:{version}"
    labelled = _labelled(tell, place, spec.labelled, JUDGING_BOTH)
    with labelled as table, parallel_config(backend="loky", n_jobs=place.processes):
        return promote_by_rule(ModelStore(place.store), which, alias, table, rule, count=tell.count, only_forward=True)


def resolve(tell: Tell, spec: EvaluateSpec, place: Place) -> str:
    """NAME:VERSION that is meant; the same however often the job is broken off, wherever an alias moves meanwhile."""
    return "{}:{}".format(*ModelStore(place.store).resolve(spec.model))


def evaluate_model(tell: Tell, spec: EvaluateSpec, place: Place, model: str) -> dict[str, Any]:
    """Judges a model by the labels of a dataset, and keeps the report.

    Args:
        tell: of itself.
        spec: of the job.
        place: where to.
        model: NAME:VERSION.

    Raises:
        InvalidParameter: too few clouds have labels to judge by.
    """
    store, objects = ModelStore(place.store), Objects(place.store)
    shape_model, manifest = store.load(*store.resolve(model))
    command = f"shape-concepts jobs submit --evaluate {model} --dataset {spec.dataset}"
    command += " --robustness" * spec.robustness
    with _labelled(tell, place, spec.dataset) as table, tempfile.TemporaryDirectory() as folder:
        report = _judged(tell, place, shape_model, manifest, Request(table, command, robustness=spec.robustness))
        # The folder of the clouds is gone when the report is read.
        named = report.model_dump_json().replace(str(table), f"dataset {spec.dataset}")
        report = Report.model_validate_json(named)
        tell.stage("report")
        names = []
        for file in (write_report(report, Path(folder)), write_page(report, shape_model, Path(folder))):
            objects.put(f"{REPORTS}/{place.job}/{file.name}", file.read_bytes())
            names.append(file.name)
    for key, why in list(report.data.unanswered.items())[:NAMED]:
        tell.log(f"unanswered {key}: {why}")
    return {
        "kind": "evaluate",
        "model": manifest.name,
        "version": manifest.version,
        "metrics": report.figures.model_dump(),
        "clouds": report.data.judged,
        "unanswered": len(report.data.unanswered),
        "reports": names,
    }


def simulate_into(tell: Tell, spec: SimulateSpec, place: Place) -> dict[str, Any]:
    """Simulates objects and adds their clouds to a dataset; those that are there already stay.

    Raises:
        CloudExists: the dataset has other clouds of the same names: of this seed, but simulated otherwise.
    """
    tell.stage("simulating", spec.count)
    datasets = Datasets(place.store)
    datasets.create(spec.dataset)
    params = SimulationParams().but(**spec.simulation)
    with shared_out(place.processes, place.cluster):
        for simulated in tell.count(simulate(spec.count, spec.seed, params=params), spec.count):
            datasets.put(
                spec.dataset,
                f"simulated/{spec.seed}/{simulated.index:08}.ply",
                write_ply(simulated.cloud),
                format="ply",
            )
    digest = datasets.digest(spec.dataset)
    return {"kind": "simulate", "dataset": spec.dataset, "clouds": spec.count, "digest": digest}


def _source(tell: Tell, spec: TrainSpec, place: Place, parent: str | None) -> Source:
    """What the model that is extended learnt from, then the datasets, then the folder, then simulated objects."""
    datasets, store = Datasets(place.store), ModelStore(place.store)
    sources: list[Source] = [Dataset(datasets, name) for name in spec.datasets]
    if spec.clouds is not None:
        sources.append(Folder(Path(spec.clouds)))
    if spec.simulate is not None:
        sources.append(Simulation(spec.simulate, spec.seed, SimulationParams().but(**spec.simulation)))
    if spec.extend is not None and parent is not None:
        manifest = store.manifest(*store.resolve(parent))
        sources = join(earlier_sources(manifest, datasets, tell.log), sources, parent)
    return sources[0] if len(sources) == 1 else Joined(sources)


@contextmanager
def _labelled(tell: Tell, place: Place, name: str, stage: str = "gathering labelled clouds") -> Iterator[Path]:
    """The labelled clouds of a dataset in a folder of this machine, for as long as they are needed: their `labels.csv`.

    Raises:
        DatasetNotFound: there is no such dataset.
        InvalidParameter: none of its clouds has a label.
    """
    tell.stage(stage)
    source = Dataset(Datasets(place.store), name)
    labels = _labels(source)
    with tempfile.TemporaryDirectory(prefix="shape-concepts-") as folder:
        rows = []
        for named in tell.count(source, source.count):
            if (label := labels.get(named.key)) is not None:
                row = Labelled(f"{named.key.removeprefix(f'{name}/')}.npy", label)
                file = Path(folder, row.file)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(as_npy(named.cloud))
                rows.append(row)
        table = Path(folder, FILE)
        table.write_bytes(write_labels(rows))
        yield table


def _labels(source: Dataset) -> dict[str, Label]:
    """The labels of a dataset's clouds, by the names that these have when they are learnt from.

    Raises:
        DatasetNotFound: there is no such dataset.
        InvalidParameter: none of its clouds has a label.
    """
    labels = {f"{source.name}/{entry.key}": entry.label for entry in source.entries if entry.label is not None}
    if not labels:
        raise InvalidParameter(f"No cloud of the dataset '{source.name}' has a label: upload a labels.csv to it.")
    return labels


def _judged(tell: Tell, place: Place, model: ShapeModel, manifest: Manifest, request: Request) -> Report:
    on_stage: Callable[[str], None] = tell.stage
    with parallel_config(backend="loky", n_jobs=place.processes):
        return evaluate(model, manifest, request, on_stage, tell.count)
