"""A real browser, headless, that looks at the page of a real service."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PHONE, DESKTOP = (390, 844), (1280, 900)  # pixels
PATIENCE = 90_000  # milliseconds: the first scene waits for the compiler
NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium() -> Iterator[Browser]:
    """The system's Chromium; skips the test where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("Chromium is not installed: ./run test --all installs it")
    options = ["--no-sandbox"] if os.geteuid() == 0 else []  # its sandbox refuses to be root's
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=options)
        yield browser
        browser.close()


class Visit:
    """A page that is looked at, and all that its browser complained about.

    Attributes:
        page: of Playwright.
        complaints: errors of scripts, and what the console was told as a warning or an error.
        refusals: status and path of every answer of the service that was no success.
        elsewhere: addresses of other hosts that something was asked of.
    """

    def __init__(self, browser: Browser, host: str, size: tuple[int, int] = DESKTOP, scheme: str = "light") -> None:
        width, height = size
        self.host = host
        self._context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        self.complaints: list[str] = []
        self.refusals: list[tuple[int, str]] = []
        self.elsewhere: list[str] = []
        self.page = self._context.new_page()
        self._listen(self.page)

    def open(self, place: str) -> Page:
        """Opens a place of the page: "#/try"."""
        self.page.goto(f"{self.host}/{place}")
        return self.page

    def again(self, url: str) -> Page:
        """Opens an address in another tab, as somebody does to whom it was sent."""
        self.page = self._context.new_page()
        self._listen(self.page)
        self.page.goto(url)
        return self.page

    def close(self) -> None:
        self._context.close()

    def check(self, *refused: tuple[int, str]) -> None:
        """Nothing went wrong, but for these refusals of the service, and nothing left the host."""
        assert self.complaints == []
        assert self.elsewhere == []
        assert set(self.refusals) == set(refused)

    def _listen(self, page: Page) -> None:
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda message: self._complain(message.type, message.text))
        page.on("request", lambda request: self._follow(request.url))
        page.on("response", lambda response: self._refuse(response.status, response.url))

    def _complain(self, kind: str, text: str) -> None:
        # What the service refuses is told to the console by the browser itself.
        if kind in ("warning", "error") and not text.startswith("Failed to load resource"):
            self.complaints.append(text)

    def _follow(self, url: str) -> None:
        if not url.startswith((f"{self.host}/", f"blob:{self.host}/", "data:")):
            self.elsewhere.append(url)

    def _refuse(self, status: int, url: str) -> None:
        if status >= 400:
            self.refusals.append((status, url.removeprefix(self.host).partition("?")[0]))


def colours(page: Page, canvas: str) -> int:
    """How many different colours a canvas shows."""
    found: int = page.evaluate(
        """(chosen) => {
            const canvas = document.querySelector(chosen);
            const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            return new Set(new Uint32Array(pixels.buffer)).size;
        }""",
        canvas,
    )
    return found


def picture(page: Page, canvas: str) -> str:
    """All that a canvas shows, to be compared."""
    shown: str = page.evaluate("(chosen) => document.querySelector(chosen).toDataURL()", canvas)
    return shown
