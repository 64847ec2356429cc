"""What a header promises, held against the limit and the bytes that are there, before anything is allocated for it."""

from __future__ import annotations

from service.engine.errors import EmptyCloud, TooManyPoints, UnreadableCloud

# What a compressed member or block may unfold to: a few points may carry much beside x, y, z, many only a little.
UNPACKED_BASE = 64 << 20  # bytes
UNPACKED_PER_POINT = 64  # bytes; PCL's largest common point (position, colour, normal, curvature) has 48


def whole_number(text: str, what: str) -> int:
    """Reads a count or size of a header: plain decimal digits, not so many that reading them costs.

    Raises:
        UnreadableCloud: it is something else; `what` begins the message.
    """
    if not (text.isascii() and text.isdigit() and len(text) <= 40):
        raise UnreadableCloud(f"{what} should be a whole number, not {quote(text)}")
    return int(text)


def check_count(count: int, max_points: int, where: str) -> None:
    """Refuses a cloud without points, or with more of them than the limit.

    Raises:
        EmptyCloud: `count` is 0.
        TooManyPoints: `count` is larger than `max_points`.
    """
    if count <= 0:
        raise EmptyCloud(f"{where} holds no points; send a cloud with at least one")
    if count > max_points:
        raise TooManyPoints(
            f"{where}, of {count} points, is over the limit of {max_points}; crop it to the object or thin it out"
        )


def check_bytes(needed: int, present: int, where: str) -> None:
    """Refuses a file that ends before what its header promises.

    Raises:
        UnreadableCloud: fewer bytes are `present` than are `needed`.
    """
    if needed > present:
        raise UnreadableCloud(
            f"{where}: its header promises {needed} bytes of data, but only {present} follow; "
            "the file is truncated, or its header wrong: write or send it again"
        )


def check_unpacked(size: int, max_points: int, where: str) -> None:
    """Refuses compressed data that would unfold to far more than a cloud at the limit needs.

    Raises:
        TooManyPoints: `size`, in bytes, is out of proportion.
    """
    limit = UNPACKED_BASE + UNPACKED_PER_POINT * max_points
    if size > limit:
        raise TooManyPoints(
            f"{where} would unfold to {size} bytes, the limit is {limit}; send fewer points or fewer fields"
        )


def quote(given: object, length: int = 60) -> str:
    """What was given, as a message shows it: never longer than `length` characters."""
    shown = repr(given)
    return shown if len(shown) <= length else f"{shown[:length]}..."
