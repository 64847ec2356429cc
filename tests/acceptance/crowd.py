"""Many clients at once, in a process of their own: `python -m tests.acceptance.crowd PORT CLIENTS SECONDS FILE`.

Each sends a cloud, waits for its answer, and sends it again; refused, it waits as long as it was told to. At the end
a line of JSON says how often each status came, and how long refusals took, seconds.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections import Counter
from pathlib import Path

HEAD = "POST /v1/responses HTTP/1.1\r\nHost: x\r\nContent-Type: application/octet-stream\r\nContent-Length: {}\r\n\r\n"


async def ask(port: int, body: bytes, until: float, told: Counter[int], refusals: list[float]) -> None:
    """One client."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    while time.monotonic() < until:
        began = time.monotonic()
        writer.write(HEAD.format(len(body)).encode() + body)
        await writer.drain()
        head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
        lines = dict(line.split(": ", 1) for line in head.split("\r\n")[1:-2])
        await reader.readexactly(int(lines["content-length"]))
        status = int(head.split()[1])
        told[status] += 1
        if status == 429:
            refusals.append(time.monotonic() - began)
            await asyncio.sleep(float(lines["retry-after"]))
    writer.close()


async def crowd(port: int, clients: int, seconds: float, body: bytes) -> None:
    """All of them."""
    told: Counter[int] = Counter()
    refusals: list[float] = []
    until = time.monotonic() + seconds
    await asyncio.gather(*(ask(port, body, until, told, refusals) for _ in range(clients)))
    print(json.dumps({"statuses": {str(status): count for status, count in told.items()}, "refusals": refusals}))


if __name__ == "__main__":
    port, clients, seconds, file = sys.argv[1:]
    asyncio.run(crowd(int(port), int(clients), float(seconds), Path(file).read_bytes()))
