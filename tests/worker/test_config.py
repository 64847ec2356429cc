from __future__ import annotations

from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter
from service.engine.params import ModelParams
from worker.config import TrainingConfig, read_config


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(text)
    return file


def test_an_empty_file_is_the_default(tmp_path: Path) -> None:
    assert read_config(written(tmp_path, "empty.toml", "")) == TrainingConfig()


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    toml = written(tmp_path, "a.toml", "[stimuli]\nsigma = 0.05\n[simulation]\nnoise = 'none'\n")
    json = written(tmp_path, "a.json", '{"stimuli": {"sigma": 0.05}, "simulation": {"noise": "none"}}')
    config = read_config(toml)
    assert config == read_config(json)
    assert config.model.stimuli.sigma == 0.05
    assert config.simulation.noise == "none"


def test_stages_stand_over_their_preset(tmp_path: Path) -> None:
    config = read_config(written(tmp_path, "p.toml", "preset = 'paper'\n[stimuli]\npooling = 'max'\n"))
    paper = ModelParams.preset("paper")
    assert config.model.descriptor == paper.descriptor
    assert config.model.stimuli == paper.stimuli.model_copy(update={"pooling": "max"})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sigma = ", "cannot be read"),
        ("preset = 'fast'", "'default' and 'paper'"),
        ("[stimuly]\nsigma = 0.1", "stimuly"),
        ("[stimuli]\nsigme = 0.1", "sigme"),
        ("[stimuli]\nsigma = -1", "sigma"),
        ("stimuli = 3", "table of their own"),
        ("[simulation]\norders = [99]", "orders"),
    ],
)
def test_what_cannot_be_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InvalidParameter, match=said):
        read_config(written(tmp_path, "wrong.toml", text))


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="cannot be read"):
        read_config(tmp_path / "none.toml")


def test_a_list_is_no_configuration(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="list"):
        read_config(written(tmp_path, "list.json", "[1, 2]"))
