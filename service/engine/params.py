"""The parameters of every stage, with their bounds, units and where they come from.

One frozen model a stage; `ModelParams` nests them. The same classes feed the command line, the manifest of a
published model and the documentation. `ModelParams.preset("paper")` holds the paper's own choices;
what the defaults gain over them is measured in `tests/benchmarks/RESULTS.md`.
"""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from service.engine.errors import InvalidParameter

MAX_OBJECTS = 1000
PRESETS = ("default", "paper")


class StageParams(BaseModel):
    """Base of all stages' parameters: frozen, and closed against misspelt names."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class CloudParams(StageParams):
    """What is taken for an object's cloud, and how finely it is looked at."""

    min_points: int = Field(100, ge=10, description="fewest points that are answered")
    min_extent: float = Field(0.002, gt=0, description="smallest plausible object, metres")
    max_extent: float = Field(10.0, gt=0, description="largest plausible object, metres")
    voxel: float = Field(1 / 32, gt=0.005, le=0.2, description="voxel edge, share of the object's extent")
    max_voxels: int = Field(
        5000, ge=100, le=100_000, description="voxels beyond which larger ones are taken: no surface has so many"
    )
    min_island: float = Field(
        0.02, ge=0, lt=0.5, description="smaller islands are scattered returns, share of the voxels"
    )
    points_per_voxel: float = Field(
        2.0,
        ge=1,
        le=20,
        description="fewest points an occupied voxel holds on average; sparser clouds get larger voxels",
    )


class PatchParams(StageParams):
    """Atomic patches: supervoxels after Papon et al. 2013 (VCCS), without colour."""

    normal_radius: float = Field(0.1, gt=0, le=0.5, description="neighbourhood of a normal, share of the extent")
    seed: float = Field(0.1, gt=0.01, le=0.5, description="distance of the seeds, share of the extent")
    normal_weight: float = Field(1.0, ge=0, description="w_n of D = w_n (1 - |n1.n2|) + w_s |dx| / seed")
    spatial_weight: float = Field(0.4, ge=0, description="w_s of D = w_n (1 - |n1.n2|) + w_s |dx| / seed")
    iterations: int = Field(5, ge=1, le=50, description="rounds of flow-constrained growth")


class SegmentParams(StageParams):
    """Super patches: patches merged across smooth borders."""

    angle: float = Field(
        30.0, gt=0, lt=180, description="border that bends by more than this beyond its patches is a crease, degrees"
    )
    min_share: float = Field(0.03, ge=0, lt=0.5, description="smaller segments are absorbed, share of the surface")
    max_segments: int = Field(24, ge=1, le=62, description="the smallest segments beyond this number are absorbed")


class DescriptorParams(StageParams):
    """FPFH (Rusu et al. 2009), and beside it distributions that see the arrangement of parts.

    The paper describes with FPFH alone (`shape_weight` 0).
    """

    fpfh_radius: float = Field(0.125, gt=0, le=0.5, description="neighbourhood of FPFH, share of the extent")
    shape_weight: float = Field(0.7, ge=0, le=1, description="weight of the shape distributions beside FPFH")
    draws: int = Field(2000, ge=100, le=100_000, description="random triples of points for a constellation")


class DictionaryParams(StageParams):
    """The hierarchical dictionary of visual words. The paper has 4 levels."""

    levels: int = Field(6, ge=1, le=10, description="n: level f holds 2^f visual words; one motif hierarchy a level")


class HierarchyParams(StageParams):
    """Propagation of constellations. In the paper wholes stand on the level that they reach (`whole_apart` False).

    All but a few motifs of whole objects are distinct, so that stimuli of all training objects would have as many
    dimensions as there are objects, and learning would take their square of memory: hence `max_objects`.
    """

    max_constellations: int = Field(
        24, ge=1, le=4096, description="constellations kept on one motif level; the largest stay, the rest is cut off"
    )
    max_levels: int = Field(12, ge=1, le=62, description="motif levels below the whole object")
    whole_apart: bool = Field(
        True, description="whole objects form a level of their own above all others, however many segments they have"
    )
    max_objects: int = Field(
        MAX_OBJECTS,
        ge=2,
        le=1_000_000,
        exclude_if=lambda count: count == MAX_OBJECTS,  # it shapes learning alone: older models that are silent load
        description="training objects whose constellations are memorised; of more, a sample's, those of the smallest "
        "content hashes: the others excite what the sample memorises, and are prototypes of concepts all the same",
    )


class StimuliParams(StageParams):
    """Eq. 1, how a vertex's several stimuli become one, and how the motif levels are weighed.

    The paper: only vertices with the constellation's very words fire (`gating` "words"), sigma = 0.025, stimuli are
    accumulated (`pooling` "sum"), a constellation's size does not count (`coverage_power` 0), and motif levels are not
    weighed against each other (`balanced` False). Here the unions between single segments and wholes weigh nothing, as
    they tell nothing that these two do not (`union_weight`, measured in `tests/benchmarks/QUALITY.md`).
    """

    sigma: float = Field(0.1, gt=0, le=1, description="bandwidth of the kernel, nats of JSD")
    gating: Literal["words", "rank", "kernel"] = Field(
        "rank",
        description="which vertices a constellation may activate: those of its motif, of its rank (single segments; "
        "unions, with the whole; wholes, which `whole_apart` tells from the rest), or all",
    )
    pooling: Literal["sum", "mean", "max"] = Field("mean", description="over the constellations that activate a vertex")
    coverage_power: float = Field(
        2.0, ge=0, le=8, description="constellations are weighted by the covered share to this power"
    )
    balanced: bool = Field(
        True, description="single segments, their unions and whole objects excite as much in total as their weights say"
    )
    segment_weight: float = Field(1.0, ge=0, le=100, description="of the vertices of motif level 1, where balanced")
    union_weight: float = Field(
        0.0, ge=0, le=100, description="of the vertices between, where balanced; 0 leaves them out of the stimuli"
    )
    whole_weight: float = Field(
        1.0, ge=0, le=100, description="of the vertices of the highest motif level, that of wholes, where balanced"
    )
    cutoff: float = Field(1e-6, ge=0, lt=0.1, description="stimuli of less than this are stored as 0")

    @model_validator(mode="after")
    def _some_weight(self) -> Self:
        if self.balanced and not self.segment_weight + self.union_weight + self.whole_weight:
            raise ValueError("of segment_weight, union_weight and whole_weight at least one is not 0")
        return self


class FiltrationParams(StageParams):
    """The filtration of the topological space."""

    max_steps: int = Field(100, ge=1, le=10_000, description="upper bound on the number of steps |E|")
    window: float = Field(
        0.1,
        ge=0,
        le=0.5,
        description="epsilon_max is the middle of the stretch of time of this length with most annexations; 0, as in "
        "the paper: the single step with most",
    )


class ResponseParams(StageParams):
    """Eq. 4: the metric between stimuli vectors, and the form of the response that is scored.

    The paper says Mahalanobis; with more dimensions than samples its covariance must be a subspace's ("subspace"),
    or the full one regularised ("diagonal", "shrunk", "identity"). The paper compares raw stimuli (`power` 1), scores
    the mean distance (`score` "distance") and answers for the concepts at epsilon_max alone (`scales` 1).
    """

    metric: Literal["subspace", "diagonal", "shrunk", "identity"] = Field(
        "subspace", description="form of the covariance"
    )
    dimensions: int = Field(16, ge=1, le=512, description="strongest components kept by the metric 'subspace'")
    power: float = Field(
        0.25,
        gt=0,
        le=1,
        description="stimuli normalised to sum 1 are compared after this power: 0.5 is Hellinger's; 1: raw stimuli",
    )
    score: Literal["discriminant", "distance"] = Field(
        "discriminant",
        description="'distance': Eq. 4; 'discriminant': squared distance to the concept's mean less twice the "
        "logarithm of its size, less the mean of that over all concepts, so that neither tight nor tiny concepts "
        "always rank first",
    )
    scales: int = Field(
        10,
        ge=1,
        le=100,
        description="beside the concepts at epsilon_max those at the times 1/n to (n-1)/n of the filtration are "
        "answered, specific and generic ones; 1: none",
    )


def _tell_presets(schema: dict[str, Any]) -> None:
    """What differs from the default in each preset, for those who fill in a form."""
    schema["x-presets"] = {
        name: ModelParams.preset(name).model_dump(mode="json", exclude_defaults=True) for name in PRESETS
    }


class ModelParams(StageParams):
    """All parameters of a shape model, stage by stage, in the order of the method."""

    model_config = ConfigDict(json_schema_extra=_tell_presets)

    cloud: CloudParams = CloudParams()
    patches: PatchParams = PatchParams()
    segments: SegmentParams = SegmentParams()
    descriptor: DescriptorParams = DescriptorParams()
    dictionary: DictionaryParams = DictionaryParams()
    hierarchy: HierarchyParams = HierarchyParams()
    stimuli: StimuliParams = StimuliParams()
    filtration: FiltrationParams = FiltrationParams()
    response: ResponseParams = ResponseParams()

    @property
    def unions_count(self) -> bool:
        """Whether unions of segments can excite anything; where they cannot, an answer needs none."""
        stimuli = self.stimuli
        told_apart = stimuli.gating == "rank" and stimuli.balanced and self.hierarchy.whole_apart
        return not (told_apart and stimuli.union_weight == 0)

    @classmethod
    def preset(cls, name: str) -> ModelParams:
        """The parameters of a named preset.

        Args:
            name: "default", or "paper" for the paper's literal choices throughout.

        Raises:
            InvalidParameter: there is no preset of that name.
        """
        if name == "default":
            return cls()
        if name == "paper":
            return cls(
                descriptor=DescriptorParams(shape_weight=0),
                dictionary=DictionaryParams(levels=4),
                hierarchy=HierarchyParams(whole_apart=False),
                stimuli=StimuliParams(
                    sigma=0.025, gating="words", pooling="sum", coverage_power=0, balanced=False, cutoff=0
                ),
                filtration=FiltrationParams(window=0),
                response=ResponseParams(metric="shrunk", power=1, score="distance", scales=1),
            )
        raise InvalidParameter(f"There is no preset '{name}'; there are 'default' and 'paper'.")
