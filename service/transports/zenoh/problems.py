"""Problem documents, as zenoh carries them: the payload of an error reply, or an answer of a stream."""

from __future__ import annotations

import logging
import uuid
from typing import Any

from service.engine.errors import Cancelled, ShapeConceptsError
from service.transports import errors

log = logging.getLogger(__name__)


class PayloadTooLarge(Exception):
    """A payload is larger than the service takes."""


def problem_of(error: BaseException, place: str) -> dict[str, Any]:
    """The problem document of whatever went wrong; what is our fault is logged as well.

    Args:
        error: one of ours, or something unexpected.
        place: the key on which it happened.

    Returns:
        The document that the other transports give, and `retry_after`, seconds, where trying again may help.
    """
    occurrence = str(uuid.uuid4())
    if isinstance(error, PayloadTooLarge):
        return errors.problem("content-too-large", "The body is too large", 413, str(error), occurrence)
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
    return document | {"retry_after": errors.RETRY_AFTER} if status.retry else document


def check_size(count: int, limit: int) -> None:
    """Refuses a payload that is too large.

    Raises:
        PayloadTooLarge: it is.
    """
    if count > limit:
        raise PayloadTooLarge(
            f"The payload of {count} bytes is larger than the {limit} that are taken. Send fewer points, or a binary "
            "format."
        )
