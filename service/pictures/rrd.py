"""Pictures as a recording for Rerun's viewer: `respond --save`; the only module that imports rerun.

A picture is a tab. In it the cloud stands in several colours, each a view; then the motifs, one entity each; beside
them the concepts, and pictures of their prototypes.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from service.answer import Answer
from service.engine.errors import InvalidParameter
from service.explanation import Likeness
from service.pictures.colours import ABSENT, FIRST, parts
from service.pictures.learnt import called, motif
from service.pictures.picture import CONCEPTS, Picture

if TYPE_CHECKING:
    import rerun

APPLICATION = "shape-concepts"
WIDEST = 20  # letters of the longest bar
BEYOND = 0x250  # the viewer's font has all Latin letters before this one
NEEDED = "A recording (.rrd) needs Rerun: pip install 'shape-concepts[rerun]'. Without it, --html draws the same."


def check_rerun() -> None:
    """Says what to install where Rerun is missing, before anything is computed.

    Raises:
        InvalidParameter: it is not installed.
    """
    if find_spec("rerun") is None:
        raise InvalidParameter(NEEDED)


def write_rrd(pictures: Sequence[Picture], file: Path) -> None:
    """Writes a recording with a tab for each picture.

    Raises:
        OSError: the file cannot be written.
    """
    import rerun
    import rerun.blueprint as blueprint

    file.open("ab").close()  # says why a file cannot be written, which Rerun does not
    stream = rerun.RecordingStream(APPLICATION)
    tabs = [_tab(blueprint, f"/{number}", picture) for number, picture in enumerate(pictures)]
    stream.save(file, blueprint.Blueprint(blueprint.Tabs(*tabs), collapse_panels=True))
    stream.log("/", rerun.ViewCoordinates.RDF, static=True)
    for number, picture in enumerate(pictures):
        _log(stream, f"/{number}", picture)
    stream.flush()
    stream.disconnect()


def _tab(blueprint: Any, root: str, picture: Picture) -> Any:
    """Where each part of a picture is shown."""
    views = [
        blueprint.Spatial3DView(name=f"by {colouring.by}", origin="/", contents=f"{root}/by_{colouring.by}")
        for colouring in picture.colourings
    ]
    told = blueprint.TextDocumentView(name="answer", origin=f"{root}/answer")
    if picture.answer is None or picture.answer.explanation is None:
        return blueprint.Horizontal(blueprint.Tabs(*views), told, column_shares=[2, 1], name=_shown(picture.title))
    later = {path: blueprint.EntityBehavior(visible=False) for path in _motifs(root, picture.answer)[1:]}
    views.append(blueprint.Spatial3DView(name="motifs", origin="/", contents=f"{root}/motifs/**", overrides=later))
    rows = [
        blueprint.Spatial2DView(name=_shown(name), origin=f"{root}/prototypes/{place}")
        for place, (name, _) in enumerate(_rows(picture.answer))
    ]
    beside = blueprint.Vertical(told, blueprint.Grid(*rows, grid_columns=2), row_shares=[3, 2])
    return blueprint.Horizontal(blueprint.Tabs(*views), beside, column_shares=[3, 2], name=_shown(picture.title))


def _log(stream: rerun.RecordingStream, root: str, picture: Picture) -> None:
    import rerun

    for colouring in picture.colourings:
        colours = np.array([parts(name) for name in colouring.colours], np.uint8)[colouring.values]
        cloud = rerun.Points3D(picture.points, colors=colours, radii=0.6 * picture.spacing)
        stream.log(f"{root}/by_{colouring.by}", cloud, static=True)
    markdown = rerun.TextDocument(_text(picture), media_type=rerun.MediaType.MARKDOWN)
    stream.log(f"{root}/answer", markdown, static=True)
    if picture.answer is None or picture.answer.explanation is None:
        return
    for place, (_, near) in enumerate(_rows(picture.answer)):
        image = np.hstack([picture.thumbnails[one.object] for one in near])
        stream.log(f"{root}/prototypes/{place}", rerun.Image(image), static=True)
    for path, fired in zip(_motifs(root, picture.answer), picture.answer.explanation.vertices, strict=True):
        covered = np.isin(picture.segments, fired.segments)
        colours = np.where(covered[:, None], parts(FIRST[0]), parts(ABSENT)).astype(np.uint8)
        stream.log(path, rerun.Points3D(picture.points, colors=colours, radii=0.6 * picture.spacing), static=True)


def _motifs(root: str, answer: Answer) -> list[str]:
    """The entity of each motif that fired: one is seen at first, the others are switched on in the viewer."""
    fired = answer.explanation.vertices if answer.explanation else []
    return [f"{root}/motifs/{place}_segments_{'_'.join(map(str, each.segments))}" for place, each in enumerate(fired)]


def _rows(answer: Answer) -> list[tuple[str, list[Likeness]]]:
    """What a row of training objects is called, and which ones are in it."""
    assert answer.explanation is not None, "asked for where there is one"
    names = {concept.id: called(concept) for concept in answer.concepts}
    best = [(names.get(each.id, f"concept {each.id}"), each.nearest) for each in answer.explanation.concepts]
    return [*best, ("most like the whole", answer.explanation.wholes)]


def _text(picture: Picture) -> str:
    """What is told beside a cloud, in Markdown."""
    answer, lines = picture.answer, [f"# {_plain(picture.title)}", *map(_plain, picture.notes)]
    if answer is None:
        return "\n\n".join(lines)
    lines.append(
        f"{answer.model}:{answer.version} at time {answer.time:.2f}: {answer.segments} segments, "
        f"{100 * answer.extent_m:.1f} cm across, **novelty {answer.novelty:.2f}**"
    )
    rows = [
        f"| {_plain(called(each))} | {'=' * round(WIDEST * share)} | {each.response:.2f} |"
        for each, share in zip(answer.concepts[:CONCEPTS], picture.bars, strict=False)
    ]
    lines.append("\n".join(["| concept | closer | response |", "|---|---|---|", *rows]))
    if answer.explanation:
        fired = [f"- {motif(each)}: {each.stimulus:.3f}" for each in answer.explanation.vertices]
        lines += ["## The motifs that fired", "\n".join(fired)]
    stages = [f"- {stage}: {time:.1f} ms" for stage, time in answer.timings_ms.items()]
    lines += [f"## Time per stage: {sum(answer.timings_ms.values()):.0f} ms", "\n".join(stages)]
    return "\n\n".join(lines)


def _plain(text: str) -> str:
    """Text without what Markdown would take for marks."""
    return "".join(f"\\{letter}" if letter in "\\`*_[]<>|#" else letter for letter in _shown(text))


def _shown(text: str) -> str:
    """Text without letters that the viewer's font lacks: it ends with an error where it meets one."""
    return "".join(letter if letter.isprintable() and ord(letter) < BEYOND else "?" for letter in text)
