"""Takes docs/page.png: the page with a simulated object that the built-in model has never seen, and its answer.

`python docs/screenshot.py` starts a service of its own and looks at it with the system's Chromium (`apt install
chromium`, `pip install playwright`).
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

OUT = Path(__file__).with_name("page.png")
PLACE = "#/try?sample=object-3.ply"
SIZE = {"width": 1280, "height": 900}
COLOURS = 256  # of the picture


def main() -> None:
    """Serves, looks, writes."""
    options = ["--no-sandbox"] if os.geteuid() == 0 else []
    with serving() as host, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        page = browser.new_page(viewport=SIZE)
        page.goto(f"{host}/{PLACE}")
        taken = look(page)
        browser.close()
    Image.open(BytesIO(taken)).convert("RGB").quantize(COLOURS).save(OUT, optimize=True)


def look(page: Page) -> bytes:
    """The page, once its answer and all pictures are there."""
    page.locator(".why .thumbnail").last.wait_for()
    page.locator(".legend-entry").nth(1).wait_for()
    page.wait_for_load_state("networkidle")
    page.locator(".try-cloud").scroll_into_view_if_needed()
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(500)
    return page.screenshot()


@contextmanager
def serving() -> Iterator[str]:
    """The address of a service whose store is empty."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "service.cli", "serve", "--store", folder]
        command += ["--port", str(port), "--grpc-port", "-1"]
        with subprocess.Popen(command) as process:
            try:
                while socket.socket().connect_ex(("127.0.0.1", port)) != 0:
                    time.sleep(0.1)
                yield f"http://127.0.0.1:{port}"
            finally:
                process.terminate()


if __name__ == "__main__":
    main()
