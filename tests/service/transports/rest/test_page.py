from __future__ import annotations

import re
from html.parser import HTMLParser

import httpx
import pytest

from service.transports.rest.page import web_files


class Links(HTMLParser):
    """What a page loads or links to, and what of it stands in the markup itself."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.inline: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.found += [value for name in ("src", "href") if (value := given.get(name))]
        if tag == "style" or (tag == "script" and "src" not in given):
            self.inline.append(tag)
        self.inline += [name for name in given if name == "style" or name.startswith("on")]


def test_all_that_the_page_links_to_is_there(client: httpx.Client) -> None:
    page = client.get("/")
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    linked = [path for path in Links(page.text).found if not path.startswith("#")]
    assert len(linked) > 3
    for path in linked:
        assert client.get(f"/{path}").status_code == 200, path


def test_every_module_that_is_imported_is_there_and_sent_as_a_script(client: httpx.Client) -> None:
    modules = [path for path in web_files() if path.endswith(".js")]
    assert len(modules) > 5
    for path in modules:
        answer = client.get(f"/page/{path}")
        assert answer.headers["content-type"] == "text/javascript; charset=utf-8"
        for imported in re.findall(r"""^(?:import|export) .*?from "(.+?)";|^import "(.+?)";""", answer.text, re.M):
            url = httpx.URL(f"/page/{path}").join(next(filter(None, imported)))
            assert client.get(str(url)).status_code == 200, f"{path} imports {url}"


def test_nothing_is_loaded_from_elsewhere_and_no_script_or_style_stands_in_the_markup(client: httpx.Client) -> None:
    page = client.get("/")
    policy = dict(part.strip().split(" ", 1) for part in page.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert {policy[kind] for kind in ("script-src", "style-src", "connect-src")} == {"'self'"}
    assert Links(page.text).inline == []
    for path, file in web_files().items():
        if path.endswith((".js", ".css", ".html")):
            text = file.content.decode().replace("http://www.w3.org/2000/svg", "")  # a name, not an address
            assert not re.search(r"https?://", text), path


@pytest.mark.parametrize("path", ["/", "/page/app.js"])
def test_a_browser_that_has_a_file_is_told_so(client: httpx.Client, path: str) -> None:
    first = client.get(path)
    again = client.get(path, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
    assert first.headers["cache-control"] == "no-cache"  # another release shows at once
    assert client.head(path).headers["etag"] == first.headers["etag"]


@pytest.mark.parametrize("path", ["/page/", "/page/../page.py", "/page/%2e%2e/settings.py", "/page//etc/passwd", "/x"])
def test_only_files_of_the_page_are_served(client: httpx.Client, path: str) -> None:
    refused = client.get(path)
    assert (refused.status_code, refused.json()["type"]) == (404, "urn:shape-concepts:error:not-found")


def test_nobody_needs_a_key_to_load_the_page(guarded: httpx.Client) -> None:
    assert guarded.get("/").status_code == 200
    assert guarded.get("/page/app.js").status_code == 200
    assert guarded.get("/v1/models").status_code == 401


def luminance(colour: str) -> float:
    """Relative luminance of "#rrggbb" (WCAG 2.2)."""
    shares = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_every_ground_in_light_and_dark(scheme: str) -> None:
    style = web_files()["style.css"].content.decode()
    blocks = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    chosen = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", blocks[0 if scheme == "light" else 1]))
    grounds = ("ground", "surface", "raised", "accent-soft", "warn-soft", "bad-soft")
    pairs = [(ink, ground) for ink in ("ink", "faint") for ground in grounds[:4]]
    pairs += [("ink", ground) for ground in grounds[4:]]
    pairs += [(ink, ground) for ink in ("accent", "good", "warn", "bad") for ground in grounds[:3]]
    pairs += [("accent", "accent-soft"), ("on-accent", "accent"), ("warn", "warn-soft"), ("bad", "bad-soft")]
    pairs += [("focus", "ground")]
    for ink, ground in pairs:
        dark, light = sorted((luminance(chosen[ink]), luminance(chosen[ground])))
        assert (light + 0.05) / (dark + 0.05) >= 4.5, f"{ink} on {ground}"


def test_every_colour_of_the_light_page_has_one_of_the_dark_page() -> None:
    light, dark = re.findall(r":root \{(.*?)\}", web_files()["style.css"].content.decode(), re.DOTALL)[:2]
    named = [set(re.findall(r"--([a-z-]+): (?:#|0 |none)", block)) for block in (light, dark)]
    assert named[0] == named[1]
