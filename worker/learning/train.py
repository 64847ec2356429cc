"""Clouds -> shape model: the method at training time, one call a stage."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from service.engine.errors import NotEnoughSamples
from service.engine.filtration import Filtration
from service.engine.metric import Metric
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.engine.perception import OnStage, ignore_stage
from service.engine.prototypes import Prototypes
from service.engine.space import TopologicalSpace
from worker.learning.concepts import extract_concepts
from worker.learning.dictionary import learn_dictionary
from worker.learning.filtration import filtrate
from worker.learning.hierarchy import grow_ensemble, sample
from worker.learning.metric import learn_metric
from worker.learning.novelty import learn_novelty
from worker.learning.observations import NamedCloud, Observation, Refusal, Unmade, observe
from worker.learning.prototypes import draw_map
from worker.learning.single import one_thread
from worker.learning.space import build_space
from worker.learning.stimuli import stimulate_all


class Trained(NamedTuple):
    """A model, and the clouds that could not be learnt from."""

    model: ShapeModel
    refused: tuple[Refusal, ...]


class Conceived(NamedTuple):
    """The parts of a `ShapeModel` that follow from the training objects' stimuli."""

    space: TopologicalSpace
    filtration: Filtration
    metric: Metric
    notes: tuple[str, ...]


def train(
    clouds: Iterable[NamedCloud | Unmade], params: ModelParams, seed: int = 0, on_stage: OnStage = ignore_stage
) -> Trained:
    """Learns dictionary, hierarchy ensemble and concepts from clouds.

    The work is shared out as `joblib.parallel_config` says; the model is the same, bit for bit, on any number of
    workers.

    Args:
        clouds: of one object each, in an order that is part of the input; made by the workers where they are not yet.
        params: of every stage.
        seed: of the map's embedding, the only random draw of learning.
        on_stage: called as each stage begins.

    Raises:
        NotEnoughSamples: fewer than two clouds can be described.
    """
    on_stage("segments and descriptors")
    objects, refused = _observe_all(clouds, params)
    return Trained(learn(objects, params, seed, on_stage), refused)


def learn(
    objects: Sequence[Observation], params: ModelParams, seed: int = 0, on_stage: OnStage = ignore_stage
) -> ShapeModel:
    """Learns dictionary, hierarchy ensemble and concepts from objects that were observed; arguments as of `train`."""
    with one_thread():
        on_stage("dictionary")
        dictionary = learn_dictionary(np.concatenate([o.segment_descriptors for o in objects]), params.dictionary)

        on_stage("motif hierarchies")
        ensemble = grow_ensemble(objects, dictionary, sample(objects, params.hierarchy.max_objects))

        on_stage("stimuli")
        stimuli = stimulate_all(objects, dictionary, ensemble, params.stimuli)

        conceived = conceive(stimuli, params, on_stage)

        on_stage("novelty")
        novelty_scale = learn_novelty(objects, ensemble)

        on_stage("map")
        prototypes = Prototypes(
            cloud_keys=tuple(o.key for o in objects),
            cloud_hashes=tuple(o.digest for o in objects),
            thumbnails=np.stack([o.thumbnail for o in objects]),
            map=draw_map(conceived.metric.embed(stimuli), seed),
        )
    return ShapeModel(
        params=params,
        dictionary=dictionary,
        ensemble=ensemble,
        stimuli=stimuli,
        novelty_scale=novelty_scale,
        prototypes=prototypes,
        **conceived._asdict(),
    )


def conceive(stimuli: csr_array, params: ModelParams, on_stage: OnStage = ignore_stage) -> Conceived:
    """What is learnt from the training objects' stimuli (N, V) alone: space, filtration, concepts and metric."""
    on_stage("topological space")
    space = build_space(stimuli)

    on_stage("filtration")
    filtration = filtrate(space, params.filtration)

    on_stage("concepts")
    filtration, notes = extract_concepts(filtration)

    on_stage("metric")
    return Conceived(space, filtration, learn_metric(stimuli, params.response), notes)


def _observe_all(
    clouds: Iterable[NamedCloud | Unmade], params: ModelParams
) -> tuple[list[Observation], tuple[Refusal, ...]]:
    seen = list(observe(clouds, params))
    objects = [result for result in seen if isinstance(result, Observation)]
    refused = tuple(result for result in seen if isinstance(result, Refusal))
    if len(objects) < 2:
        why = f" The first that was refused is {refused[0].key}: {refused[0].error}" if refused else ""
        raise NotEnoughSamples(
            f"Learning needs at least 2 clouds that can be described; there are {len(objects)}.{why}"
        )
    return objects, refused
