"""Draws docs/concepts.png: what a model learned from simulated objects alone, a row a concept.

You will see, for each of the largest concepts, the simulated objects at its heart, as the virtual sensor saw them:
`python docs/picture.py` simulates 250 objects, learns from them, and takes about a minute.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from joblib import parallel_config
from PIL import Image, ImageDraw, ImageFont

from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from worker.learning.observations import NamedCloud
from worker.learning.train import train
from worker.simulation import simulate
from worker.simulation.contact_sheet import BACKGROUND, INK, draw_tile

COUNT, SEED = 250, 7
ROWS, COLUMNS, TILE = 6, 9, 112  # concepts, prototypes of each, pixels
LABEL = 120  # pixels
OUT = Path(__file__).with_name("concepts.png")


def main() -> None:
    """Simulates, learns, draws."""
    tiles, clouds = [], []
    with parallel_config(backend="loky", n_jobs=-1):
        for simulated in simulate(COUNT, SEED):
            tiles.append(draw_tile(simulated, TILE))
            clouds.append(NamedCloud(str(simulated.index), simulated.cloud))
        model, _ = train(clouds, ModelParams(), SEED)
    draw(model, tiles).save(OUT, optimize=True)


def draw(model: ShapeModel, tiles: list[Image.Image]) -> Image.Image:
    """A row for each of the largest concepts, its most central prototypes first."""
    concepts = model.concepts()
    rows = min(ROWS, len(concepts.sizes))
    sheet = Image.new("RGB", (LABEL + COLUMNS * TILE, rows * TILE), BACKGROUND)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for row in range(rows):
        text = f"concept {concepts.ids[row]}\n{concepts.sizes[row]} prototypes"
        pen.multiline_text((12, row * TILE + TILE // 2 - 18), text, fill=INK, font=font, spacing=5)
        for column, prototype in enumerate(heart(model, row)[:COLUMNS]):
            sheet.paste(tiles[prototype], (LABEL + column * TILE, row * TILE))
    return sheet


def heart(model: ShapeModel, concept: int) -> list[int]:
    """A concept's prototypes, those nearest to the mean of all first."""
    members = np.flatnonzero(model.concepts().assignment == concept)
    places = model.embedded_prototypes[members]
    return members[np.linalg.norm(places - places.mean(axis=0), axis=1).argsort(kind="stable")].tolist()


if __name__ == "__main__":
    main()
