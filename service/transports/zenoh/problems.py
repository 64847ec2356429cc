"""Problem documents, as zenoh carries them: the payload of an error reply, or an answer of a stream."""

from __future__ import annotations

import logging
from typing import Any

from service.engine.errors import Cancelled, ContentTooLarge, ShapeConceptsError
from service.transports import errors

log = logging.getLogger(__name__)


def problem_of(error: BaseException, place: str, occurrence: str) -> dict[str, Any]:
    """The problem document of whatever went wrong; what is our fault is logged as well.

    Args:
        error: one of ours, or something unexpected.
        place: the key on which it happened.
        occurrence: names it, a UUID.

    Returns:
        The document that the other transports give, and `retry_after`, seconds, where trying again may help.
    """
    if not isinstance(error, ShapeConceptsError):
        log.error("%s %s: unexpected", occurrence, place, exc_info=error)
        detail = "The service failed unexpectedly; its log says more under the id of this occurrence."
        return errors.problem("internal", errors.INTERNAL.title, 500, detail, occurrence)
    status = errors.status_of(error)
    if status.http >= 500:
        log.error("%s %s: %s: %s", occurrence, place, error.type_name(), error)
    elif isinstance(error, Cancelled):
        log.info("%s %s: %s", occurrence, place, error)
    document = errors.problem_of(error, occurrence)
    return document | {"retry_after": status.retry} if status.retry else document


def check_size(count: int, limit: int) -> None:
    """Refuses a payload that is too large.

    Raises:
        ContentTooLarge: it is.
    """
    if count > limit:
        raise ContentTooLarge(
            f"The payload of {count} bytes is larger than the {limit} that are taken. Send fewer points, or a binary "
            "format."
        )
