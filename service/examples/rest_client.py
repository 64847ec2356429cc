"""Asks a running service about clouds over HTTP, with Python's standard library alone.

    python -m service.examples.rest_client mug.ply
    python -m service.examples.rest_client --address http://robot:8000 --model default scans/*.ply

This file needs nothing of the service but its address: copy it where you like. You will see a line for each file: how
new the object is to the model, and the three concepts that it resembles most, best first, each with its name if it has
one and its response (smaller is closer). Of a file that cannot be answered you will see why, and the exit code is 1.

Where the service asks for an access key, put it into the environment as ACCESS_KEY.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

PATIENCE = 60.0  # seconds
ATTEMPTS = 5  # while the service has too much to do


def main() -> None:
    """Asks, and prints what is answered."""
    parser = argparse.ArgumentParser(description="Asks a running service about clouds over HTTP.")
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="PCD, PLY, XYZ, NPY or NPZ")
    parser.add_argument("--address", default="http://localhost:8000", help="of the service (default: %(default)s)")
    parser.add_argument("--model", help="NAME, NAME@ALIAS or NAME:VERSION (default: the service's)")
    given = parser.parse_args()

    failed = 0
    for file in given.files:
        try:
            print(f"{file}: {tell(ask(given.address, file.read_bytes(), given.model))}")
        except urllib.error.URLError as error:
            sys.exit(f"nobody answers at {given.address}, is the service there? ({error.reason})")
        except (OSError, ValueError) as error:
            failed += 1
            print(f"{file}: {error}", file=sys.stderr)
    sys.exit(1 if failed else 0)


def ask(address: str, cloud: bytes, model: str | None) -> dict[str, Any]:
    """The answer to a cloud. Where the service has too much to do, it is asked again when it says.

    Raises:
        ValueError: the cloud cannot be answered; the message is the service's.
        OSError: the service cannot be reached.
    """
    parameters = {"top": "3"} | ({"model": model} if model else {})
    headers = {"Content-Type": "application/octet-stream"}  # the content tells the format
    if key := os.environ.get("ACCESS_KEY"):
        headers["Authorization"] = f"Bearer {key}"
    url = f"{address}/v1/responses?{urllib.parse.urlencode(parameters)}"
    for attempt in range(1, ATTEMPTS + 1):
        try:
            with urllib.request.urlopen(urllib.request.Request(url, cloud, headers), timeout=PATIENCE) as response:
                answer: dict[str, Any] = json.load(response)
                return answer
        except urllib.error.HTTPError as error:
            wait = error.headers.get("Retry-After")
            if wait is None or attempt == ATTEMPTS:
                raise ValueError(json.load(error)["detail"]) from None
            time.sleep(float(wait))
    raise AssertionError("the last attempt returns or raises")


def tell(answer: dict[str, Any]) -> str:
    """An answer in a line."""
    concepts = [f"{each['name'] or each['id']} ({each['response']:.1f})" for each in answer["concepts"]]
    return f"novelty {answer['novelty']:.2f}, concepts {', '.join(concepts)}"


if __name__ == "__main__":
    main()
