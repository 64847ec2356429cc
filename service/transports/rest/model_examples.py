"""The examples of what the API tells of models, batches and names: what a model of 250 simulated objects answered.

Lists of concepts, objects, bars and edges are cut short.
"""

from __future__ import annotations

from typing import Any

PROMOTED: dict[str, Any] = {"model": "default", "alias": "production", "version": 1}

ROLLED_BACK: dict[str, Any] = {"model": "default", "alias": "production", "version": 1}

NAME: dict[str, Any] = {"model": "default", "version": 1, "concept": 433, "name": "box"}

NAMES: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "names": [{"concept": 433, "name": "box", "carried_from": None}],
}

CARRIED: dict[str, Any] = {
    "model": "default",
    "version": 2,
    "carried_from": "default:1",
    "names": [{"concept": 612, "name": "box", "before": 433, "jaccard": 0.8333333333333334}],
}

COMPARISON: dict[str, Any] = {
    "old": {"model": "default", "version": 1, "time": 0.9319999999999999},
    "new": {"model": "default", "version": 2, "time": 0.9},
    "shared": 250,
    "asked": 100,
    "left_out": 0,
    "fates": {"persists": 1, "merges": 1},
    "origins": {"persists": 1},
    "old_concepts": [
        {
            "id": 433,
            "name": "box",
            "prototypes": 5,
            "objects": 6,
            "concepts": [{"id": 612, "name": "box", "objects": 5, "jaccard": 0.8333333333333334}],
            "fate": "persists",
        },
        {
            "id": 421,
            "name": None,
            "prototypes": 3,
            "objects": 4,
            "concepts": [{"id": 640, "name": None, "objects": 4, "jaccard": 0.08}],
            "fate": "merges",
        },
    ],
    "new_concepts": [
        {
            "id": 612,
            "name": "box",
            "prototypes": 5,
            "objects": 5,
            "concepts": [{"id": 433, "name": "box", "objects": 5, "jaccard": 0.8333333333333334}],
            "origin": "persists",
        }
    ],
    "same_concepts": [
        {"old": 433, "new": 612, "jaccard": 0.8333333333333334, "old_name": "box", "new_name": "box"},
    ],
}

UNNAMED: dict[str, Any] = {"model": "default", "version": 1, "concept": 433, "name": None}

NAME_HISTORY: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "concept": 433,
    "name": None,
    "history": [
        {"name": "box", "at": "2026-11-22T10:24:29+00:00", "carried_from": None},
        {"name": None, "at": "2026-11-22T10:24:29+00:00", "carried_from": None},
    ],
}

MODEL: dict[str, Any] = {
    "name": "default",
    "versions": [1, 2],
    "aliases": {"production": 1, "staging": 2},
    "version": 1,
}

ALIASES: dict[str, Any] = {
    "model": "default",
    "aliases": {"production": [{"version": 1, "action": "promote", "at": "2026-11-22T10:18:56+00:00"}]},
}

CONCEPTS: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "epsilon_max": 0.9319999999999999,
    "time": 0.9319999999999999,
    "concepts": [
        {"id": 433, "name": None, "prototypes": 2, "time": 0.9319999999999999, "objects": [12, 239]},
        {"id": 421, "name": None, "prototypes": 2, "time": 0.9319999999999999, "objects": [17, 70]},
        {"id": 432, "name": None, "prototypes": 5, "time": 0.9319999999999999, "objects": [7, 50, 60, 115, 180]},
    ],
    "objects": [
        {
            "object": 12,
            "key": "simulated/7/12",
            "hash": "b348859ba9b665d5dd9630426521506a89b1bd25b4a98b6bcf86184790381fde",
            "map": [-4.757134914398193, -9.817938804626465],
        },
        {
            "object": 239,
            "key": "simulated/7/239",
            "hash": "d4491b882182482160c09b00e289ba972391021d450b6ff3c5e0d1bcd6ac9c3d",
            "map": [-8.102934837341309, -0.6139273643493652],
        },
    ],
    "thumbnails": "/v1/models/default/versions/1/objects/{object}.png",
}

LABELS: dict[str, Any] = {"model": "workshop", "version": 3, "labelled": 2, "categories": ["mug", None, "bowl"]}

BARCODE: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "epsilon_max": 0.9319999999999999,
    "bars": [[0.0, 0.0321410057024365], [0.0, 0.064282011404873], [0.0, 1.0], [0.0, None]],
}

ANNEXATIONS: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "epsilon_max": 0.9319999999999999,
    "edges": [[40, 0], [37, 1], [2, 96]],
    "time": [0.3856920684292379, 0.8356661482633488, 0.9160186625194401],
    "order": [24, 126, 180],
    "distance": [0.39540816326530615, 0.8229591836734694, 0.9081632653061225],
    "moments": [0.0, 0.0321410057024365, 0.064282011404873, 0.09642301710730948],
    "annexations": [1, 1, 1, 1],
}

TREE: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "epsilon_max": 0.9319999999999999,
    "edges": [[0, 40], [1, 37], [2, 144]],
    "distance": [6.290945427778194e-05, 1.7620804799167722e-05, 0.0001168680706675751],
    "vertex_heat": [39.808, 26.4, 23.008],
}

PROPOSALS: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "applied": False,
    "proposals": [
        {"concept": 433, "name": "box", "current": None, "support": 1, "share": 1.0, "labels": {"box": 1}, "tied": []}
    ],
    "left_out": [
        {
            "file": "torn.ply",
            "label": "mug",
            "problem": {
                "type": "urn:shape-concepts:error:unreadable-cloud",
                "title": "The cloud cannot be read",
                "status": 400,
                "detail": "PLY: no header from 'ply' to 'end_header' in its first 39 "
                "bytes; the file is truncated in its header, or no PLY",
                "instance": "urn:uuid:cbea6a34-a1e5-4d4b-85cf-e3a0bdd00112",
            },
        }
    ],
}

BATCH: dict[str, Any] = {
    "model": "default",
    "version": 1,
    "items": [
        {
            "file": "corner.xyz",
            "answer": {
                "model": "default",
                "version": 1,
                "time": 0.9319999999999999,
                "concepts": [
                    {
                        "id": 433,
                        "name": None,
                        "response": -26.589728274301166,
                        "distance": 10.213714556660985,
                        "rank": 1,
                        "prototypes": 2,
                        "time": 0.9319999999999999,
                    }
                ],
                "novelty": 0.992,
                "segments": 3,
                "extent_m": 0.14435725843247954,
                "truncated": False,
                "warnings": [],
                "timings_ms": {
                    "decode": 0.406,
                    "normalise": 2.074,
                    "patches": 0.915,
                    "segments": 0.76,
                    "constellations": 0.115,
                    "descriptors": 1.936,
                    "stimuli": 6.328,
                    "novelty": 0.348,
                    "responses": 1.002,
                },
            },
        },
        {
            "file": "torn.ply",
            "problem": {
                "type": "urn:shape-concepts:error:unreadable-cloud",
                "title": "The cloud cannot be read",
                "status": 400,
                "detail": "PLY: no header from 'ply' to 'end_header' in its first 39 "
                "bytes; the file is truncated in its header, or no PLY",
                "instance": "urn:uuid:cbea6a34-a1e5-4d4b-85cf-e3a0bdd00112",
            },
        },
    ],
}
