"""The colours of what is drawn: the same one for the same number in every format."""

from __future__ import annotations

import numpy as np

# Okabe and Ito, Color Universal Design, 2008, without black, which cannot be seen by night.
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7", "#f0e442")
ABSENT = "#8a8f99"  # of what belongs to nothing
STEPS = 64  # colours of a scale
# Four places of viridis (van der Walt and Smith), from low to high, dark ones left out for the sake of the night.
_SCALE = ("#3b528b", "#21918c", "#5ec962", "#fde725")
_PALER, _DARKER = 0.45, 0.35  # how much of white, of black is mixed in once the colours are used up


def colour(number: int) -> str:
    """The colour of a segment, a concept or a word by its place, from 0; after seven they come paler, then darker."""
    name, turn = COLOURS[number % len(COLOURS)], number // len(COLOURS) % 3
    if turn == 1:
        return _mixed(name, "#ffffff", _PALER)
    return _mixed(name, "#000000", _DARKER) if turn == 2 else name


def scale() -> tuple[str, ...]:
    """Colours from low to high."""
    places = np.linspace(0, len(_SCALE) - 1, STEPS)
    return tuple(
        _mixed(_SCALE[low], _SCALE[min(low + 1, len(_SCALE) - 1)], float(place - low))
        for low, place in zip(places.astype(int).tolist(), places.tolist(), strict=True)
    )


def parts(name: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#rrggbb"."""
    return int(name[1:3], 16), int(name[3:5], 16), int(name[5:7], 16)


def _mixed(one: str, other: str, share: float) -> str:
    mixed = (round((1 - share) * a + share * b) for a, b in zip(parts(one), parts(other), strict=True))
    return "#" + "".join(f"{part:02x}" for part in mixed)
