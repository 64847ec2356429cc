"""Makes every call of the Open Inference Protocol with Triton's client, and prints what came of each as JSON.

Runs in an environment of its own, since the client wants another protobuf than the service. Arguments: the service's
HTTP address, its gRPC address, and an NPY file of a cloud.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

import numpy as np
import tritonclient.grpc as over_grpc
import tritonclient.grpc.aio as over_grpc_aio
import tritonclient.http as over_http
import tritonclient.http.aio as over_http_aio
from tritonclient.utils import InferenceServerException

WANTED = ("ranking", "responses", "stimuli_index", "stimuli_value", "truncated", "warnings")


def input_of(triton: Any, cloud: np.ndarray, **how: Any) -> Any:
    tensor = triton.InferInput("cloud", list(cloud.shape), "FP32")
    tensor.set_data_from_numpy(cloud, **how)
    return tensor


def told(result: Any, names: Any = ()) -> dict[str, Any]:
    """An answer: what it says of the model, and its tensors."""
    response = result.get_response(as_json=True) if isinstance(result, over_grpc.InferResult) else result.get_response()
    names = names or [output["name"] for output in response["outputs"]]
    values = {name: result.as_numpy(name) for name in names}
    texts = {
        name: [text.decode() if isinstance(text, bytes) else text for text in array.tolist()]
        for name, array in values.items()
    }
    return {
        "model": response["model_name"],
        "version": response["model_version"],
        "id": response.get("id"),
        "dtypes": {name: str(array.dtype) for name, array in values.items()},
        "values": texts,
    }


def failing(call: Any, *given: Any, **more: Any) -> dict[str, str]:
    try:
        call(*given, **more)
    except InferenceServerException as error:
        return {"message": error.message(), "status": error.status()}
    return {"message": "", "status": "it did not fail"}


def calls(client: Any, triton: Any, cloud: np.ndarray, ways_in: list[Any], ways_out: list[Any]) -> dict[str, Any]:
    as_json = {"as_json": True} if triton is over_grpc else {}
    moved = cloud * 1000
    parameters = {"time": 0.3, "top": 2, "unit": "mm", "viewpoint": "0,0,-100"}
    return {
        "live": client.is_server_live(),
        "ready": client.is_server_ready(),
        "model_ready": client.is_model_ready("tiny"),
        "version_ready": client.is_model_ready("tiny", "1"),
        "other_ready": client.is_model_ready("other"),
        "server": client.get_server_metadata(**as_json),
        "model": client.get_model_metadata("tiny", "1", **as_json),
        "plain": [told(client.infer("tiny", [input_of(triton, cloud, **way)], request_id="7")) for way in ways_in],
        "wanted": [
            told(
                client.infer(
                    "tiny@production",
                    [input_of(triton, cloud, **way)],
                    outputs=[triton.InferRequestedOutput(name, **out) for name in WANTED],
                ),
                WANTED,
            )
            for way in ways_in
            for out in ways_out
        ],
        "parameters": told(client.infer("tiny", [input_of(triton, moved)], model_version="1", parameters=parameters)),
        "scheduled": told(
            client.infer(
                "tiny", [input_of(triton, cloud)], sequence_id=5, sequence_start=True, priority=2, timeout=10**7
            )
        ),
        "no_model": failing(client.infer, "other", [input_of(triton, cloud)]),
        "no_points": failing(client.infer, "tiny", [input_of(triton, np.full_like(cloud, np.nan))]),
        "no_metadata": failing(client.get_model_metadata, "other"),
    }


async def at_once(client: Any, triton: Any, cloud: np.ndarray) -> list[dict[str, Any]]:
    """Three requests side by side."""
    async with client:
        asked = [client.infer("tiny", [input_of(triton, cloud)]) for _ in range(3)]
        return [told(result) for result in await asyncio.gather(*asked)]


def main() -> None:
    """Calls, and prints."""
    http, grpc, file = sys.argv[1:]
    cloud = np.load(file)
    patience = {"network_timeout": 60.0, "connection_timeout": 60.0}
    ways = [{"binary_data": True}, {"binary_data": False}]
    client = over_http.InferenceServerClient(http, **patience)
    packed = {"request_compression_algorithm": "gzip", "response_compression_algorithm": "deflate"}
    other_packed = {"request_compression_algorithm": "deflate", "response_compression_algorithm": "gzip"}
    found = {
        "packed": [told(client.infer("tiny", [input_of(over_http, cloud)], **each)) for each in (packed, other_packed)],
        "http": calls(client, over_http, cloud, ways, ways),
        "grpc": calls(over_grpc.InferenceServerClient(grpc), over_grpc, cloud, [{}], [{}]),
        "http_at_once": asyncio.run(at_once_over_http(http, cloud)),
        "grpc_at_once": asyncio.run(at_once_over_grpc(grpc, cloud)),
    }
    json.dump(found, sys.stdout)


async def at_once_over_http(address: str, cloud: np.ndarray) -> list[dict[str, Any]]:
    return await at_once(over_http_aio.InferenceServerClient(address), over_http, cloud)


async def at_once_over_grpc(address: str, cloud: np.ndarray) -> list[dict[str, Any]]:
    return await at_once(over_grpc_aio.InferenceServerClient(address), over_grpc, cloud)


if __name__ == "__main__":
    main()
