"""`shape-concepts respond --html FILE --save FILE`: the answers of a call as pictures in files."""

from __future__ import annotations

import os
from functools import cache, partial
from pathlib import Path

import click

from service.answer import Answer
from service.application import Application, CloudFile
from service.clouds import read_scene
from service.pictures.html import write_html
from service.pictures.learnt import Learnt
from service.pictures.picture import Picture, draw_cloud, draw_scene
from service.pictures.rrd import check_rerun, write_rrd
from service.scene_answer import SceneAnswer

MOST = 50  # clouds of a call


class Drawing:
    """Pictures that are drawn one by one, and written together.

    Args:
        html: file of the page, if there shall be one.
        save: file of the recording, if there shall be one.
        clouds: how many will be drawn.

    Raises:
        click.BadParameter: there cannot be such a file.
        InvalidParameter: what it takes is not installed.
    """

    def __init__(self, html: Path | None, save: Path | None, clouds: int) -> None:
        self._html, self._save = html, save
        self._pictures: list[Picture] = []
        option = "--html" if html else "--save"
        if save and save.suffix != ".rrd":
            raise click.BadParameter(
                f"'{save}' is a recording for Rerun and ends in .rrd; a page for the browser is --html FILE.",
                param_hint="--save",
            )
        if clouds > MOST:
            raise click.BadParameter(
                f"{clouds} clouds are too many for one file; draw at most {MOST} at a time, into several files.",
                param_hint=option,
            )
        for file in (html, save):
            if file and not file.parent.is_dir():
                raise click.BadParameter(f"There is no folder '{file.parent}'; make it first.", param_hint=option)
            if file and not os.access(file if file.exists() else file.parent, os.W_OK):
                raise click.BadParameter(f"'{file}' cannot be written; give another place.", param_hint=option)
        if save:
            check_rerun()

    def add(self, application: Application, cloud: CloudFile, answer: Answer | SceneAnswer) -> None:
        """Draws a cloud and its answer, which has its explanation and the segments of its points."""
        sent = read_scene(
            cloud.data,
            cloud.format,
            name=cloud.name,
            unit=cloud.unit,
            viewpoint=cloud.viewpoint,
            camera=cloud.camera,
            mask=cloud.mask,
            max_points=application.settings.max_points,
        )
        title = "standard input" if cloud.name == "-" else Path(cloud.name).name

        @cache
        def learnt(time: float) -> Learnt:
            which = (answer.model, answer.version)
            return Learnt(application.models.concepts(*which, time), application.models.annexations(*which))

        thumbnail = partial(application.looking.thumbnail, answer.model, answer.version)
        if isinstance(answer, SceneAnswer):
            self._pictures += draw_scene(title, sent, answer, lambda of: learnt(of.time), thumbnail)
        else:
            self._pictures.append(draw_cloud(title, sent, answer, lambda of: learnt(of.time), thumbnail))

    def write(self) -> None:
        """Writes what was drawn, and says so; nothing where no cloud was answered.

        Raises:
            click.ClickException: a file cannot be written.
        """
        if not self._pictures:
            return
        try:
            self._write()
        except OSError as error:
            raise click.ClickException(
                f"The picture cannot be written: {error.strerror or error}. Give another place."
            ) from error

    def _write(self) -> None:
        if self._html:
            unfinished = self._html.with_name(f".{self._html.name}.{os.getpid()}")
            try:
                unfinished.write_text(write_html(self._pictures), encoding="utf-8")
                unfinished.replace(self._html)
            finally:
                unfinished.unlink(missing_ok=True)
            click.echo(f"Wrote {self._html}: open it in a browser.", err=True)
        if self._save:
            write_rrd(self._pictures, self._save)
            click.echo(f"Wrote {self._save}: look at it with `rerun {self._save}`.", err=True)


def as_asked(answer: Answer | SceneAnswer, *, explain: bool, segments: bool) -> Answer | SceneAnswer:
    """An answer without what only its picture needed."""
    if isinstance(answer, Answer):
        unasked = ["explanation"] * (not explain) + ["point_segments"] * (not segments)
        return answer.model_copy(update=dict.fromkeys(unasked))
    objects = [
        one.model_copy(update={"answer": one.answer and as_asked(one.answer, explain=explain, segments=segments)})
        for one in answer.objects
    ]
    return answer.model_copy(update={"objects": objects} | ({} if segments else {"point_objects": None}))
