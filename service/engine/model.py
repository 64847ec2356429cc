"""The shape model: a cloud becomes a response, stage by stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine import tensors as layout
from service.engine.cloud import PointCloud
from service.engine.concepts import (
    Concepts,
    Spectrum,
    concepts_at,
    rank_concepts,
    respond_to_concepts,
    spectrum_at,
    spread_of,
    squared_distances,
)
from service.engine.dictionary import Dictionary
from service.engine.divergence import Distributions
from service.engine.explain import Evidence, Explanation, explain_response
from service.engine.filtration import Filtration, time_step
from service.engine.metric import Metric
from service.engine.motifs import Ensemble
from service.engine.novelty import NoveltyScale, divergences_from, whole_of
from service.engine.params import ModelParams
from service.engine.perception import OnStage, Perception, ignore_stage, perceive
from service.engine.points import segments_of_points
from service.engine.prototypes import Prototypes
from service.engine.space import TopologicalSpace
from service.engine.stimuli import Stimuli, excite, stimulate


@dataclass(frozen=True)
class Response:
    """What an object's cloud has in common with each concept.

    Attributes:
        responses: (K,) float64: rho^o in the form that is scored; smaller is closer.
        distances: (K,) float64: the mean Mahalanobis distances of Eq. 4; smaller is closer.
        concept_ids: (K,) int64: the concepts' nodes in the merge tree; those at `time` first.
        concept_sizes: (K,) int64: numbers of concept prototypes.
        concept_times: (K,) float64: the filtration time at which each was taken, [0, 1].
        ranking: (K,) int64: places of the concepts, those at `time` before all others, closest first.
        novelty: how unlike everything learned the object is, [0, 1]: the share of the training objects that are less
            apart from all others.
        time: the filtration time of the first concepts, [0, 1].
        segments: number of segments S that the object was seen to have.
        extent_m: the object's robust diameter, metres.
        truncated: whether constellations were cut off.
        warnings: what is odd about the cloud, in sentences.
        stimuli: *gamma^o.
        point_segments: (N,) int32: the segment of each point of the cloud, or (M,) of its file, or of each point that
            was asked about, -1 for none; None if it was not asked for.
        explanation: why the response is what it is; None if it was not asked for.
    """

    responses: NDArray[np.float64]
    distances: NDArray[np.float64]
    concept_ids: NDArray[np.int64]
    concept_sizes: NDArray[np.int64]
    concept_times: NDArray[np.float64]
    ranking: NDArray[np.int64]
    novelty: float
    time: float
    segments: int
    extent_m: float
    truncated: bool
    warnings: tuple[str, ...]
    stimuli: Stimuli
    point_segments: NDArray[np.int32] | None = None
    explanation: Explanation | None = None


class Comparison(NamedTuple):
    """An object among the training objects.

    Attributes:
        squared: (N,) float64: squared Mahalanobis distances from the training objects.
        responses: (K,) float64: *CR_o, the form that is scored.
        distances: (K,) float64: Eq. 4.
    """

    squared: NDArray[np.float64]
    responses: NDArray[np.float64]
    distances: NDArray[np.float64]


@dataclass(frozen=True)
class ShapeModel:
    """All that was learnt; immutable.

    Attributes:
        params: the parameters of every stage.
        dictionary: D.
        ensemble: HE.
        stimuli: (N, V) float32 sparse: the training objects' stimuli vectors, raw.
        space: the topological space X.
        filtration: of X, with F.
        metric: between stimuli vectors.
        novelty_scale: what novelty is measured by.
        prototypes: what is known of the training objects.
        notes: what the rules for degenerate outcomes had to say.
    """

    params: ModelParams
    dictionary: Dictionary
    ensemble: Ensemble
    stimuli: csr_array
    space: TopologicalSpace
    filtration: Filtration
    metric: Metric
    novelty_scale: NoveltyScale
    prototypes: Prototypes
    notes: tuple[str, ...]

    def respond(
        self,
        cloud: PointCloud,
        *,
        time: float | None = None,
        explain: bool = False,
        segments: bool | PointCloud = False,
        on_stage: OnStage = ignore_stage,
    ) -> Response:
        """Tells which concepts an object's cloud resembles.

        Args:
            cloud: of one object, in the sensor's frame.
            time: filtration time of the concepts, [0, 1]; None for epsilon_max and, after its concepts, those of the
                other scales.
            explain: whether the response says why it is what it is.
            segments: whether it says of each point of the cloud to which segment it belongs; or some points of the
                cloud, of which alone it shall say that.
            on_stage: called as each stage begins.

        Raises:
            InvalidCloud: the cloud cannot be described; a child says why.
            InvalidParameter: the time is out of range.
        """
        spectrum = self.spectrum(time)
        seen = perceive(cloud, self.params, on_stage, unions=self.params.unions_count)

        on_stage("stimuli")
        words = self._words(seen, explain)
        stimuli = stimulate(self.ensemble, seen.constellations, seen.descriptors, words, self.params.stimuli)

        on_stage("novelty")
        whole = seen.descriptors[whole_of(seen.constellations)]
        divergences = divergences_from(whole, self.wholes)

        on_stage("responses")
        squared, responses, distances = self.compare(stimuli, spectrum)
        ranking = rank_concepts(responses, spectrum)

        explanation, point_segments = None, None
        if explain:
            on_stage("explanation")
            excitation = excite(self.ensemble, seen.constellations, seen.descriptors, words, self.params.stimuli)
            evidence = Evidence(seen, words, excitation, stimuli, np.sqrt(squared), divergences, ranking)
            explanation = explain_response(evidence, self.ensemble, spectrum, self.prototypes)
        if segments:
            on_stage("points")
            point_segments = segments_of_points(cloud if segments is True else segments, seen.graph)
        return Response(
            responses=responses,
            distances=distances,
            concept_ids=spectrum.ids,
            concept_sizes=spectrum.sizes,
            concept_times=spectrum.times,
            ranking=ranking,
            novelty=self.novelty_scale.novelty(divergences.min()),
            time=spectrum.concepts.time,
            segments=seen.graph.count,
            extent_m=seen.graph.frame.extent,
            truncated=seen.constellations.truncated,
            warnings=seen.warnings,
            stimuli=stimuli,
            point_segments=point_segments,
            explanation=explanation,
        )

    def _words(self, seen: Perception, explain: bool) -> NDArray[np.int64]:
        """The visual words of an object's segments (S, n); (0, n) where neither stimuli nor explanation need them."""
        if explain or self.params.stimuli.gating == "words":
            return self.dictionary.words(seen.segment_descriptors)
        return np.zeros((0, len(self.dictionary.levels)), np.int64)

    def compare(self, stimuli: Stimuli, spectrum: Spectrum) -> Comparison:
        """How far an object is from the training objects, by its stimuli, and its responses to the concepts."""
        squared = squared_distances(stimuli, self.metric, self.embedded_prototypes)
        whole = spectrum is self.__dict__.get("_whole_spectrum")
        spread = self._whole_spread if whole else spread_of(spectrum, self.embedded_prototypes)
        return Comparison(squared, *respond_to_concepts(squared, spectrum, spread, self.params.response))

    def concepts(self, time: float | None = None) -> Concepts:
        """The concepts at a filtration time; None for epsilon_max."""
        return concepts_at(self.filtration, time)

    @cached_property
    def embedded_prototypes(self) -> NDArray[np.float64]:
        """The concept prototypes in the metric's coordinates (N, k)."""
        return self.metric.embed(self.stimuli)

    def spectrum(self, time: float | None = None) -> Spectrum:
        """The concepts to compare an object with: those at a time; None for those at epsilon_max and of all scales."""
        return self._whole_spectrum if time is None else spectrum_at(self.filtration, time, 1)

    @cached_property
    def _whole_spectrum(self) -> Spectrum:
        return spectrum_at(self.filtration, None, self.params.response.scales)

    @cached_property
    def _whole_spread(self) -> NDArray[np.float64]:
        return spread_of(self._whole_spectrum, self.embedded_prototypes)

    @cached_property
    def wholes(self) -> Distributions:
        """The training objects' wholes, to be compared with."""
        return self.ensemble.distributions.of(self.novelty_scale.wholes)

    def facts(self) -> dict[str, Any]:
        """What the manifest says of the model beside its parameters."""
        levels = [len(h.vertices) for h in self.ensemble.hierarchies]
        return {
            "counts": {
                "objects": self.stimuli.shape[0],
                "motif_prototypes": len(self.ensemble.prototypes),
                "motif_vertices": self.ensemble.vertex_count,
                "motif_vertices_of_hierarchies": levels,
                "concepts": len(self.concepts().sizes),
                "concepts_of_all_scales": len(self.spectrum().sizes),
            },
            "stimuli_fill": self.stimuli.nnz / (self.stimuli.shape[0] * self.stimuli.shape[1]),
            "filtration_step": time_step(self.filtration.distance, self.params.filtration.max_steps),
            "epsilon_max": self.filtration.epsilon_max,
            "notes": list(self.notes),
        }

    def to_tensors(self) -> dict[str, NDArray[Any]]:
        """The model as named arrays; the parameters stand apart, in the manifest."""
        return layout.to_tensors(self)

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, NDArray[Any]], params: ModelParams) -> ShapeModel:
        """The model that `to_tensors` wrote.

        Raises:
            ModelDamaged: tensors are missing, of the wrong kind, or do not fit together.
        """
        return cls(params=params, **layout.from_tensors(tensors, params))
