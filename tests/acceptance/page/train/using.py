"""How tests use Train: what they drop, submit and read there."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import httpx

from service.clouds import write_ply
from tests.learnt import objects

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

JOB = 120_000  # milliseconds that a small job may take


def told(host: str, path: str, **query: Any) -> Any:
    """What the service says without a browser."""
    return httpx.get(f"{host}/v1/{path}", params=query, timeout=60).raise_for_status().json()


def ply(number: int) -> bytes:
    return write_ply(objects()[number].cloud)


def drop(page: Page, files: dict[str, bytes]) -> None:
    """Drops files as a hand does that has dragged them from a folder."""
    sent = [[name, base64.b64encode(content).decode()] for name, content in files.items()]
    transfer = page.evaluate_handle(
        """(files) => {
            const transfer = new DataTransfer();
            for (const [name, content] of files) {
                transfer.items.add(new File([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))], name));
            }
            return transfer;
        }""",
        sent,
    )
    page.dispatch_event(".drop", "dragover", {"dataTransfer": transfer})
    page.dispatch_event(".drop", "drop", {"dataTransfer": transfer})


def verdicts(page: Page) -> dict[str, str]:
    """What became of each file that was sent."""
    page.get_by_text("All is there.").wait_for()
    rows = page.locator(".verdicts tbody tr").all()
    return {row.locator("td").nth(0).inner_text(): row.locator("td").nth(1).inner_text() for row in rows}


def new_dataset(page: Page, name: str) -> None:
    page.get_by_label("Dataset", exact=True).select_option(label="A new dataset …")
    page.get_by_label("Name of the new dataset").fill(name)


def learn(page: Page, name: str, **choices: str) -> None:
    """Asks for a model learnt from the shelf alone."""
    page.get_by_label("Name of the model").fill(name)
    page.get_by_label("shelf", exact=True).check()
    page.get_by_label("simulated objects", exact=True).uncheck()
    for label, choice in choices.items():
        page.get_by_label(label.replace("_", " ")).select_option(choice)
    page.get_by_role("button", name="Submit").click()


def job(page: Page) -> Locator:
    return page.locator("article.job")


def state(page: Page, name: str) -> None:
    """Waits until the job that is shown is in a state."""
    job(page).locator(f".badge-{name}").wait_for(timeout=JOB)


def serving(page: Page) -> str:
    """The version that bears the alias production on the page."""
    return page.locator(".versions tr", has_text="production").locator("th a").inner_text()
