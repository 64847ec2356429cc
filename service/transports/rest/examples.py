"""The examples of the API's description: a cloud to send, and what a model of 250 simulated objects answered.

The lists of all responses and distances, and those of the explanation, are cut short.
"""

from __future__ import annotations

from typing import Any

from service.engine.errors import (
    CloudExists,
    JobConflict,
    ModelDamaged,
    ModelNotFound,
    NotAllowed,
    NotAuthenticated,
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
CLOUD_JSON: dict[str, Any] = {
    "points": [[float(word) for word in line.split()] for line in CLOUD_XYZ.splitlines()],
    "unit": "m",
    "viewpoint": [0, 0, 0],
}

ANSWER: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "time": 0.9319999999999999,
    "responses": [
        -20.497199517318137,
        -11.860334719012513,
        -17.208008444675997,
        -2.089345207573217,
        -18.26630172066423,
        -7.270892716288401,
    ],
    "distances": [
        11.304278110830708,
        11.52755614464174,
        10.842687141396656,
        11.683797892642207,
        10.534194745880889,
        11.057515526360016,
    ],
    "concepts": [
        {
            "id": 433,
            "name": None,
            "response": -21.060333521539548,
            "distance": 10.596042083198407,
            "rank": 1,
            "prototypes": 2,
            "time": 0.9319999999999999,
        },
        {
            "id": 430,
            "name": None,
            "response": -20.497199517318137,
            "distance": 11.304278110830708,
            "rank": 2,
            "prototypes": 82,
            "time": 0.9319999999999999,
        },
    ],
    "novelty": 0.992,
    "segments": 3,
    "extent_m": 0.14435725843247954,
    "truncated": False,
    "warnings": [],
    "timings_ms": {
        "decode": 0.373,
        "normalise": 2.152,
        "patches": 0.99,
        "segments": 0.731,
        "constellations": 0.103,
        "descriptors": 1.913,
        "stimuli": 7.877,
        "novelty": 0.326,
        "responses": 0.748,
    },
}

SCENE_ANSWER: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "plane": {
        "normal": [-0.00030798630718150235, -0.7657332370223112, -0.6431582347010473],
        "offset_m": 0.643174485735153,
        "sensor_height_m": 0.643174485735153,
        "points": 57688,
    },
    "objects": [
        {
            "number": 0,
            "position_m": [-0.1296537241900669, -0.01740117839930029, 0.8981995299410105],
            "sensor_position_m": [-0.1296537241900669, -0.01740117839930029, 0.8981995299410105],
            "distance_m": 0.9076753,
            "box": {
                "centre_m": [-0.1316, -0.0226, 0.9242],
                "size_m": [0.07434138128848089, 0.0735279103386065, 0.12058290847554598],
                "axes": [[0.8, -0.386, 0.459], [-0.6, -0.515, 0.612], [0.0, -0.766, -0.643]],
            },
            "height_m": [0.0029506458596488816, 0.12353355433519486],
            "points": 2799,
            "touches": [],
            "hidden_by": [],
            "at_border": None,
            "beyond_edge": False,
            "answer": ANSWER,
            "error": None,
        },
    ],
    "left_out": [
        {"reason": "below", "detail": "below the plane, or behind it", "points": 982, "pieces": 0},
        {"reason": "small", "detail": "too small or of too few points for an object", "points": 11, "pieces": 10},
    ],
    "warnings": [],
    "timings_ms": {"decode": 9.412, "tabletop": 102.349, "normalise": 6.02, "responses": 1.113},
}


def _near(number: int, sha256: str, distance: float) -> dict[str, Any]:
    return {"object": number, "key": f"simulated/7/{number}", "hash": sha256, "distance": distance}


EXPLANATION: dict[str, Any] = {
    "segments": [
        {
            "share": 0.36363636363636365,
            "adjacent": [1, 2],
            "words": [1, 2, 5, 11, 22, 47],
            "centroid_m": [0.013461980508610773, 0.033297655569710385, 0.6510653698541965],
            "extent_m": 0.10296161266535765,
            "nearest": [
                _near(212, "76cf06c3e79e6a850aefd1d6ef1e91af7fd7aa256cb74c47b6df1e149de2ab94", 0.010006431490182877)
            ],
        },
        {
            "share": 0.3522727272727273,
            "adjacent": [0, 2],
            "words": [1, 3, 6, 13, 26, 53],
            "centroid_m": [0.014961561844612972, -0.033820587863475714, 0.652416403754894],
            "extent_m": 0.11026625076894675,
            "nearest": [
                _near(212, "76cf06c3e79e6a850aefd1d6ef1e91af7fd7aa256cb74c47b6df1e149de2ab94", 0.008551286533474922)
            ],
        },
        {
            "share": 0.2840909090909091,
            "adjacent": [0, 1],
            "words": [1, 2, 5, 11, 22, 44],
            "centroid_m": [-0.033944665281462526, 0.000825598973961465, 0.64980487481014],
            "extent_m": 0.11385308461906732,
            "nearest": [
                _near(22, "9c4eb25f1aa55f65d342cadcace14b00ab07cddfb282e2caf379aa94b125935c", 0.0157399233430624)
            ],
        },
    ],
    "vertices": [
        {
            "vertex": 2875,
            "hierarchy": 6,
            "also_in": [],
            "level": 1,
            "words": [55],
            "stimulus": 47.98649978637695,
            "segments": [0],
            "prototypes": 38,
            "nearest": [
                _near(32, "85ba28ab9edea407814bb232b21d858f45e5a73d5de2bd23d5f6fe2a4b02ec79", 0.016646917909383774)
            ],
        },
        {
            "vertex": 2877,
            "hierarchy": 6,
            "also_in": [],
            "level": 1,
            "words": [60],
            "stimulus": 47.68075180053711,
            "segments": [0],
            "prototypes": 32,
            "nearest": [
                _near(172, "4ce120853a6974822ca4b0ead58c4977964b0272f60e59cc9ab6cd0dd2464658", 0.019359957426786423)
            ],
        },
    ],
    "concepts": [
        {
            "id": 433,
            "nearest": [
                _near(239, "d4491b882182482160c09b00e289ba972391021d450b6ff3c5e0d1bcd6ac9c3d", 9.758420680755703)
            ],
        },
        {
            "id": 430,
            "nearest": [
                _near(103, "80cea30fff4ef82c29819d5ef00dcbcda536ec0b780722dc9c010d927cd9911c", 8.311741842543485)
            ],
        },
    ],
    "wholes": [_near(103, "80cea30fff4ef82c29819d5ef00dcbcda536ec0b780722dc9c010d927cd9911c", 0.020626001060009003)],
    "thumbnails": "/v1/models/default/versions/1/objects/{object}.png",
}

MODELS: dict[str, Any] = {
    "models": [{"name": "default", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}, "built_in": False}],
}

READINESS: dict[str, Any] = {"model": "default", "version": 1, "models": ["default"], "built_in": False}

MANIFEST: dict[str, Any] = {
    "name": "default",
    "version": 1,
    "created": "2026-11-22T10:37:34Z",
    "format": "shape-concepts-model",
    "format_version": 4,
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
        "motif_vertices": 4321,
        "motif_vertices_of_hierarchies": [61, 224, 507, 845, 1190, 1494],
        "concepts": 14,
        "concepts_of_all_scales": 45,
    },
    "stimuli_fill": 0.2335107613978246,
    "filtration_step": 0.016070502851218246,
    "epsilon_max": 0.9319999999999999,
    "notes": [],
    "contents": {
        "model.safetensors": {
            "sha256": "ecf076753dd9d645a029027c2c62b2c40f3acdb4c2b132aa94aee2b304e43138",
            "size": 4966042,
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
    "digest": "450b95fbbd9f5ae802337bdbcd327cf03af8bc21faec31915549c7631cc61ff9",
}

_ERRORS: tuple[ShapeConceptsError, ...] = (
    NotAuthenticated("An access key is needed; ask the operator of the service for one."),
    NotAllowed("The access key 'robot-7' allows to answer, not to manage."),
    UnreadableCloud("The form has no file in the field 'cloud': send it with -F cloud=@FILE."),
    ModelNotFound("There is no 'mugs@production'. The store holds: default."),
    CloudExists(
        "The dataset 'mugs' has another cloud 'kitchen/box-7.xyz': give this one another key, or say that it shall "
        "replace it."
    ),
    TooManyPoints(
        "the PCD file promises 1000000000000 points, the limit is 5000000; crop the cloud to the object or thin it out"
    ),
    UnsupportedFormat("no format has the media type 'image/jpeg'; send application/octet-stream: the content tells"),
    TooFewPoints(
        "The cloud has 12 points; at least 100 are needed. Move the sensor closer, or send the cloud at a higher "
        "resolution."
    ),
    JobConflict("The job 'nightly-2025-01-31' is done; submit another one to do it again."),
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
