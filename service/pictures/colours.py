"""The colours of what is drawn: the same one for the same number in every format, and on the service's page."""

from __future__ import annotations

import colorsys

# Apart from one another also for those who see red and green alike (after Okabe and Ito), as far as eight can be.
FIRST = ("#0f7ac0", "#e07b00", "#0b9e77", "#c95aa0", "#8e6bd1", "#c8a415", "#4fb4e6", "#d14b2f")
ABSENT = "#8b94a0"  # of what belongs to nothing
STEPS = 64  # colours of a scale
_GOLDEN = 137.50776405  # degrees: each further hue is as far as can be from those before
_SCALE = ((59, 76, 162), (38, 130, 142), (63, 170, 110), (190, 200, 60), (250, 220, 90))  # from low to high


def colour(number: int) -> str:
    """The colour of a segment, a visual word or a bar of the filtration, by its number; -1 is none."""
    if number < 0:
        return ABSENT
    if number < len(FIRST):
        return FIRST[number]
    third = number % 3
    hue, lightness, saturation = number * _GOLDEN % 360 / 360, 0.45 + 0.08 * third, 0.5 + 0.1 * third
    return _hex(tuple(255 * part for part in colorsys.hls_to_rgb(hue, lightness, saturation)))


def scale() -> tuple[str, ...]:
    """Colours from low to high, ever lighter."""
    shares = [step / (STEPS - 1) * (len(_SCALE) - 1) for step in range(STEPS)]
    return tuple(_between(share, min(int(share), len(_SCALE) - 2)) for share in shares)


def parts(name: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#rrggbb"."""
    return int(name[1:3], 16), int(name[3:5], 16), int(name[5:7], 16)


def _between(share: float, below: int) -> str:
    low, high = _SCALE[below], _SCALE[below + 1]
    return _hex(tuple(a + (b - a) * (share - below) for a, b in zip(low, high, strict=True)))


def _hex(rgb: tuple[float, ...]) -> str:
    return "#" + "".join(f"{int(part + 0.5):02x}" for part in rgb)
