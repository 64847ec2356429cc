from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from service import clouds
from service.application import Application, CloudFile
from service.settings import Settings
from worker.samples import INDEX, make, write

SHIPPED = files("service") / "web" / "samples"


def test_the_samples_that_are_shipped_are_those_that_the_command_makes(tmp_path: Path) -> None:
    write(tmp_path)
    shipped = json.loads((SHIPPED / INDEX).read_text())
    made = json.loads((tmp_path / INDEX).read_text())
    assert [(entry["file"], entry["title"], entry["scene"]) for entry in made] == [
        (entry["file"], entry["title"], entry["scene"]) for entry in shipped
    ]
    assert {entry.name for entry in SHIPPED.iterdir()} == {entry["file"] for entry in shipped} | {INDEX}
    for entry in shipped:
        ours, theirs = (
            clouds.read(folder.joinpath(entry["file"]).read_bytes()).points for folder in (tmp_path, SHIPPED)
        )
        assert len(theirs) == entry["points"]
        # Another processor may round rays at silhouettes otherwise.
        assert len(ours) == pytest.approx(len(theirs), rel=0.01)
        assert np.allclose(ours.mean(axis=0), theirs.mean(axis=0), atol=2e-3)


def test_the_built_in_model_answers_every_sample(tmp_path: Path) -> None:
    application = Application(Settings(store=str(tmp_path / "store"), jobs_url=f"sqlite:///{tmp_path / 'jobs.sqlite'}"))
    for sample in make():
        file = CloudFile((SHIPPED / sample.file).read_bytes(), name=sample.file)
        if sample.scene:
            assert [one.error for one in application.respond_scene(file).objects] == [None] * 3
        else:
            answer = application.respond(file)
            assert answer.concepts
            assert answer.warnings == []
    application.close()
