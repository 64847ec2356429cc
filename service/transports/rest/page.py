"""The page at /: files of service/web, as they are. They hold no data, so that nobody needs a key to load them."""

from __future__ import annotations

import mimetypes
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import NamedTuple

from fastapi import APIRouter, Response
from starlette.exceptions import HTTPException

from service.transports.rest.caching import CHECKED, IfNoneMatch, tag_of, tagged

FOLDER = "web"
INDEX = "index.html"
MEDIA_TYPES = {
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}  # whatever the system says
TEXTS = ("text/", "image/svg", "application/json")
SECURITY = {
    # Nothing from elsewhere, no script or style within markup; pictures that need an access key are blobs.
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class WebFile(NamedTuple):
    """A file of the page.

    Attributes:
        content: its bytes.
        media_type: of these.
        tag: changes when the content does.
    """

    content: bytes
    media_type: str
    tag: str


@cache
def web_files() -> dict[str, WebFile]:
    """The page's files by their paths; there are no others, whatever path is asked for."""
    return dict(_found(files("service") / FOLDER, ""))


def router() -> APIRouter:
    """The page. It is no part of the API that /openapi.json describes."""
    routes = APIRouter(include_in_schema=False)

    @routes.api_route("/", methods=["GET", "HEAD"])
    def index(if_none_match: IfNoneMatch = None) -> Response:
        return _served(INDEX, if_none_match)

    @routes.api_route("/page/{path:path}", methods=["GET", "HEAD"])
    def file(path: str, if_none_match: IfNoneMatch = None) -> Response:
        if path not in web_files():
            raise HTTPException(404)
        return _served(path, if_none_match)

    return routes


def _served(path: str, if_none_match: str | None) -> Response:
    """A file; browsers keep it and ask before each use whether it is so still, so that a new release shows at once."""
    found = web_files()[path]
    answer = tagged(found.tag, if_none_match, CHECKED, lambda: found.content, found.media_type)
    answer.headers.update(SECURITY)
    return answer


def _found(folder: Traversable, above: str) -> list[tuple[str, WebFile]]:
    found: list[tuple[str, WebFile]] = []
    for entry in folder.iterdir():
        path = f"{above}{entry.name}"
        if entry.is_dir():
            found += _found(entry, f"{path}/")
        else:
            content = entry.read_bytes()
            found.append((path, WebFile(content, _media_type(path), tag_of(path, content))))
    return found


def _media_type(path: str) -> str:
    ending = path[path.rfind(".") :]
    kind = MEDIA_TYPES.get(ending) or mimetypes.guess_type(path)[0] or "application/octet-stream"
    return f"{kind}; charset=utf-8" if kind.startswith(TEXTS) else kind
