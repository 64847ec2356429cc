"""Asks a running service about a cloud with Triton's own client, over the Open Inference Protocol.

    python -m venv triton && triton/bin/pip install 'tritonclient[http,grpc]'
    triton/bin/python open_inference_client.py mug.npy
    triton/bin/python open_inference_client.py --grpc --address robot:8001 --model mugs mug.xyz

This file needs nothing of the service but its address: copy it where you like. The client wants an older protobuf than
the service, so it has an environment of its own. You will see which version of the model answered, how new the object
is to it, and the three concepts that it resembles most, best first, each with its response (smaller is closer).

Where the service asks for an access key, put it into the environment as ACCESS_KEY.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import tritonclient.grpc as over_grpc
import tritonclient.http as over_http
from tritonclient.utils import InferenceServerException

OUTPUTS = ("responses", "concept_ids", "ranking", "novelty")
PATIENCE = 60.0  # seconds


def main() -> None:
    """Asks, and prints what is answered."""
    parser = argparse.ArgumentParser(description="Asks a running service about a cloud with Triton's client.")
    parser.add_argument("file", type=Path, help="NPY of (N, 3) metres, or text of a point a line: x y z")
    parser.add_argument("--grpc", action="store_true", help="ask over gRPC (default: HTTP)")
    parser.add_argument("--address", help="of the service (default: localhost:8000, localhost:8001 for gRPC)")
    parser.add_argument("--model", default="default", help="NAME or NAME@ALIAS (default: %(default)s)")
    given = parser.parse_args()

    triton = over_grpc if given.grpc else over_http
    address = given.address or ("localhost:8001" if given.grpc else "localhost:8000")
    patience = {} if given.grpc else {"network_timeout": PATIENCE, "connection_timeout": PATIENCE}
    client = triton.InferenceServerClient(address, **patience)

    cloud = read(given.file)
    tensor = triton.InferInput("cloud", list(cloud.shape), "FP32")
    tensor.set_data_from_numpy(cloud)
    try:
        result = client.infer(
            given.model,
            [tensor],
            outputs=[triton.InferRequestedOutput(name) for name in OUTPUTS],
            headers=who_asks(),
            parameters={"top": 3},
        )
    except InferenceServerException as error:
        print(f"{given.file}: {error.message()}", file=sys.stderr)
        sys.exit(1)

    responses, ids, ranking, novelty = (result.as_numpy(name) for name in OUTPUTS)
    response = result.get_response()
    name, version = (
        (response.model_name, response.model_version)
        if given.grpc
        else (response["model_name"], response["model_version"])
    )
    concepts = ", ".join(f"{ids[place]} ({responses[place]:.1f})" for place in ranking)
    print(f"{given.file}: {name}:{version}, novelty {novelty[0]:.2f}, concepts {concepts}")


def read(file: Path) -> np.ndarray:
    """The points of a file (N, 3)."""
    points = np.load(file) if file.suffix == ".npy" else np.loadtxt(file, usecols=(0, 1, 2), ndmin=2)
    return np.ascontiguousarray(points, np.float32)


def who_asks() -> dict[str, str]:
    """What names the caller: the access key, if there is one."""
    key = os.environ.get("ACCESS_KEY")
    return {"authorization": f"Bearer {key}"} if key else {}


if __name__ == "__main__":
    main()
