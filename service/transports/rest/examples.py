"""The examples of the API's description: a cloud to send, and what a model of 250 simulated objects answered."""

from __future__ import annotations

from typing import Any

from service.engine.errors import (
    ModelDamaged,
    ModelNotFound,
    Overloaded,
    ShapeConceptsError,
    StoreUnavailable,
    TooFewPoints,
    TooManyPoints,
    UnreadableCloud,
    UnsupportedFormat,
)
from service.engine.params import ModelParams
from service.transports.errors import problem, problem_of

REQUEST_ID = "cbea6a34-a1e5-4d4b-85cf-e3a0bdd00112"


def _corner(edge: float = 0.08, step: float = 0.01, distance: float = 0.6) -> str:
    """The three visible sides of a box, seen along its diagonal, as text: metres, x right, y down, z forward."""
    ways = ((0.8165, 0.0, 0.5774), (-0.4082, 0.7071, 0.5774), (-0.4082, -0.7071, 0.5774))  # away from the near corner
    count = round(edge / step) + 1
    lines = []
    for side in range(3):
        u, v = ways[side], ways[(side + 1) % 3]
        for i in range(count):
            for j in range(1, count):
                x, y, z = (step * (i * a + j * b) for a, b in zip(u, v, strict=True))
                lines.append(f"{x:.4f} {y:.4f} {distance + z:.4f}\n")
    return "".join(lines)


CLOUD_XYZ = _corner()

ANSWER: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "time": 0.8740422923689856,
    "responses": [
        13.684531549903966,
        8.505764470971712,
        26.97776117593969,
        -11.772847589609398,
        12.899224052406964,
        0.8557227219109791,
        -13.887430627214144,
        1.1549763020798878,
        5.572808853861261,
        -6.554284551597732,
        -10.758146132880427,
        2.7164480741026296,
        -6.425123000737017,
        -22.96940529913786,
    ],
    "distances": [
        18.327999441185437,
        18.22979279226735,
        18.70239598863765,
        17.676538446600652,
        18.26300307357269,
        18.031128945837327,
        17.5970010933869,
        18.03605250664077,
        18.15500654433049,
        17.829795670232507,
        17.70996429669157,
        18.08405954755469,
        17.833919773255538,
        17.362796660659768,
    ],
    "concepts": [
        {
            "id": 436,
            "name": None,
            "response": -22.96940529913786,
            "distance": 17.362796660659768,
            "rank": 1,
            "prototypes": 2,
        },
        {
            "id": 431,
            "name": None,
            "response": -13.887430627214144,
            "distance": 17.5970010933869,
            "rank": 2,
            "prototypes": 7,
        },
    ],
    "segments": 4,
    "extent_m": 0.14435725843247954,
    "truncated": False,
    "warnings": [],
    "timings_ms": {
        "decode": 1.05,
        "normalise": 2.057,
        "patches": 1.763,
        "segments": 0.73,
        "constellations": 0.19,
        "descriptors": 3.727,
        "stimuli": 34.321,
        "responses": 0.968,
    },
}

MODELS: dict[str, Any] = {
    "models": [{"name": "default", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}}],
}

READINESS: dict[str, Any] = {"model": "default", "version": 1, "models": ["default"]}

MANIFEST: dict[str, Any] = {
    "name": "default",
    "version": 1,
    "created": "2026-11-22T03:52:58Z",
    "format": "shape-concepts-model",
    "format_version": 1,
    "seed": 7,
    "params": ModelParams().model_dump(mode="json"),
    "source": {"simulated": 250, "orders": [1, 2, 3, 4, 5], "noise": "kinect", "renderer": "raycast", "seed": 7},
    "counts": {
        "objects": 250,
        "motif_prototypes": 3972,
        "motif_vertices": 3143,
        "motif_vertices_of_hierarchies": [88, 358, 983, 1714],
        "concepts": 14,
    },
    "stimuli_fill": 1.0,
    "filtration_step": 0.019000919399325775,
    "epsilon_max": 0.8740422923689856,
    "notes": [],
    "contents": {
        "model.safetensors": {
            "sha256": "cf19174b743eacd582a59a88af8f551e1281929fb0a6c5f3b876636bb3d62624",
            "size": 10544359,
        }
    },
    "libraries": {
        "shape-concepts": "0.1.0",
        "python": "3.11.7",
        "numpy": "2.4.6",
        "scipy": "1.17.1",
        "numba": "0.68.1",
    },
    "digest": "2ff4473b832345e05bed46e72d6640902a4d8814e792dcfabff2928767ce25e2",
}

_ERRORS: tuple[ShapeConceptsError, ...] = (
    UnreadableCloud("The form has no file in the field 'cloud': send it with -F cloud=@FILE."),
    ModelNotFound("There is no 'mugs@production'. The store holds: default."),
    TooManyPoints(
        "the PCD file promises 1000000000000 points, the limit is 5000000; crop the cloud to the object or thin it out"
    ),
    UnsupportedFormat("no format has the media type 'image/png'; send application/octet-stream: the content tells"),
    TooFewPoints(
        "The cloud has 12 points; at least 100 are needed. Move the sensor closer, or send the cloud at a higher "
        "resolution."
    ),
    Overloaded("36 requests are already at work or waiting; try again in a second."),
    ModelDamaged("default:1 is refused. model.safetensors was cut off or replaced."),
    StoreUnavailable(),
)
_LATE = problem(
    "request-timeout",
    "The request took too long to arrive",
    408,
    "The body did not arrive within 60 seconds.",
    REQUEST_ID,
)

PROBLEMS: dict[int, dict[str, Any]] = {
    document["status"]: document for document in (_LATE, *(problem_of(error, REQUEST_ID) for error in _ERRORS))
}
