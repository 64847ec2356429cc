"""The examples of the API's description: a cloud to send, and what a model of 250 simulated objects answered.

The lists of the explanation are cut short.
"""

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
    "time": 0.7265241488519398,
    "responses": [
        -3.587485990522444,
        -0.12465411915562276,
        0.08452292426229956,
        0.8972513109184432,
        5.217964214202714,
        -0.3185437000535783,
        -1.0959653958322326,
        1.1523439187971516,
        -4.468551102158495,
        2.888672247202159,
        -0.7479542890242926,
        -0.42198891880742173,
    ],
    "distances": [
        17.066674235422873,
        17.067583039251346,
        17.402422562709557,
        17.710595140595743,
        18.05754286831713,
        17.102789865508697,
        16.608890809030417,
        17.880627771020418,
        16.21518806387815,
        17.571783571957635,
        19.215213472923164,
        17.06444833960621,
    ],
    "concepts": [
        {
            "id": 359,
            "name": None,
            "response": -4.468551102158495,
            "distance": 16.21518806387815,
            "rank": 1,
            "prototypes": 3,
        },
        {
            "id": 357,
            "name": None,
            "response": -3.587485990522444,
            "distance": 17.066674235422873,
            "rank": 2,
            "prototypes": 45,
        },
    ],
    "novelty": 0.992,
    "segments": 3,
    "extent_m": 0.14435725843247954,
    "truncated": False,
    "warnings": [],
    "timings_ms": {
        "decode": 0.793,
        "normalise": 6.504,
        "patches": 1.039,
        "segments": 4.863,
        "constellations": 0.13,
        "descriptors": 1.928,
        "stimuli": 16.645,
        "novelty": 0.357,
        "responses": 0.727,
    },
}


def _near(number: int, sha256: str, distance: float) -> dict[str, Any]:
    return {"object": number, "key": f"simulated/7/{number}", "hash": sha256, "distance": distance}


EXPLANATION: dict[str, Any] = {
    "segments": [
        {
            "share": 0.36363636363636365,
            "adjacent": [1, 2],
            "words": [1, 2, 5, 11],
            "centroid_m": [0.013461980508610773, 0.033297655569710385, 0.6510653698541965],
            "extent_m": 0.10296161266535765,
            "nearest": [
                _near(212, "76cf06c3e79e6a850aefd1d6ef1e91af7fd7aa256cb74c47b6df1e149de2ab94", 0.010006431490182877)
            ],
        },
        {
            "share": 0.3522727272727273,
            "adjacent": [0, 2],
            "words": [1, 3, 6, 13],
            "centroid_m": [0.014961561844612972, -0.033820587863475714, 0.652416403754894],
            "extent_m": 0.11026625076894675,
            "nearest": [
                _near(212, "76cf06c3e79e6a850aefd1d6ef1e91af7fd7aa256cb74c47b6df1e149de2ab94", 0.008551286533474922)
            ],
        },
        {
            "share": 0.2840909090909091,
            "adjacent": [0, 1],
            "words": [1, 2, 5, 11],
            "centroid_m": [-0.033944665281462526, 0.000825598973961465, 0.64980487481014],
            "extent_m": 0.11385308461906732,
            "nearest": [
                _near(22, "9c4eb25f1aa55f65d342cadcace14b00ab07cddfb282e2caf379aa94b125935c", 0.0157399233430624)
            ],
        },
    ],
    "vertices": [
        {
            "vertex": 1036,
            "hierarchy": 4,
            "also_in": [],
            "level": 3,
            "words": [10, 11, 11],
            "stimulus": 0.9951596856117249,
            "segments": [0, 1, 2],
            "prototypes": 1,
            "nearest": [
                _near(148, "ec6da62a1ff44170b276117b5351402277f32b087ac51645e1bbb01149544c5a", 0.007880778051912785)
            ],
        },
        {
            "vertex": 710,
            "hierarchy": 4,
            "also_in": [],
            "level": 4,
            "words": [13, 13, 13, 13],
            "stimulus": 0.9803434610366821,
            "segments": [0, 1, 2],
            "prototypes": 1,
            "nearest": [
                _near(32, "85ba28ab9edea407814bb232b21d858f45e5a73d5de2bd23d5f6fe2a4b02ec79", 0.01594081148505211)
            ],
        },
    ],
    "concepts": [
        {
            "id": 359,
            "nearest": [
                _near(118, "6cc34a4e91b715d560e9eba49e183b8624e5e4ee936f6825da2d1d050e2c2e37", 15.726652353091646)
            ],
        },
        {
            "id": 357,
            "nearest": [
                _near(30, "ec1f2d10b9117da102fd670894aed90a909b5b2226d26990558fe303e719d9b6", 13.576869948244642)
            ],
        },
    ],
    "wholes": [_near(103, "80cea30fff4ef82c29819d5ef00dcbcda536ec0b780722dc9c010d927cd9911c", 0.020626001060009003)],
    "thumbnails": "/v1/models/default/versions/1/objects/{object}.png",
}

MODELS: dict[str, Any] = {
    "models": [{"name": "default", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}}],
}

READINESS: dict[str, Any] = {"model": "default", "version": 1, "models": ["default"]}

MANIFEST: dict[str, Any] = {
    "name": "default",
    "version": 1,
    "created": "2026-11-22T05:29:48Z",
    "format": "shape-concepts-model",
    "format_version": 2,
    "seed": 7,
    "params": ModelParams().model_dump(mode="json"),
    "source": {
        "kind": "simulation",
        "clouds": 250,
        "seed": 7,
        "parameters": {
            "orders": [1, 2, 3, 4, 5],
            "noise": "kinect",
            "renderer": "sapien",
            "min_points": 500,
            "prototypes": {"shortest": 0.03, "longest": 0.2, "overlap": 0.003, "exposed": 0.1, "chord": 4e-05},
            "camera": {"width": 640, "height": 480, "focal": 525.0, "nearest": 0.6, "farthest": 1.4, "lowest": 0.0},
            "sensor": {"baseline": 0.075, "disparity_steps": 8, "grazing": 80.0},
        },
    },
    "counts": {
        "objects": 250,
        "motif_prototypes": 2193,
        "motif_vertices": 1295,
        "motif_vertices_of_hierarchies": [46, 155, 390, 704],
        "concepts": 12,
    },
    "stimuli_fill": 1.0,
    "filtration_step": 0.019635787806809187,
    "epsilon_max": 0.7265241488519398,
    "notes": [],
    "contents": {
        "model.safetensors": {
            "sha256": "cbc6c518265ef95b0c4c43fc277b802d726465f76123402e7172c417b8769f83",
            "size": 4999839,
        }
    },
    "libraries": {
        "shape-concepts": "0.1.0",
        "python": "3.11.7",
        "numpy": "2.4.6",
        "scipy": "1.17.1",
        "numba": "0.68.1",
        "scikit-learn": "1.9.1",
        "open3d-cpu": "0.20.0",
        "sapien": "3.0.3",
    },
    "digest": "e395a87014ef8f65a175a95feb1634e0e9d8f2a275fddb88a24c4581b2876f1b",
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
