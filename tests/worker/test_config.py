from __future__ import annotations

from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter
from service.engine.params import ModelParams
from worker.config import TrainingConfig, read_config
from worker.simulation.params import SimulationParams


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


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_preset_is_that_of_the_stages_and_of_the_simulation(tmp_path: Path, preset: str) -> None:
    config = read_config(written(tmp_path, "p.toml", f"preset = '{preset}'"))
    assert config.model == ModelParams.preset(preset)
    assert config.simulation == SimulationParams.preset(preset)


def test_a_table_within_the_simulation_stands_over_its_preset(tmp_path: Path) -> None:
    said = "preset = 'paper'\n[simulation]\nnoise = 'none'\n[simulation.prototypes]\nlongest = 0.3\n"
    config = read_config(written(tmp_path, "p.toml", said))
    paper = SimulationParams.preset("paper")
    prototypes = paper.prototypes.model_copy(update={"longest": 0.3})
    assert config.simulation == paper.model_copy(update={"noise": "none", "prototypes": prototypes})
    assert config.model == ModelParams.preset("paper")


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
        ("[simulation.prototypes]\nlongset = 0.1", "longset"),
        ("[simulation.prototype]\nlongest = 0.1", "prototype"),
        ("[simulation]\nprototypes = 3", "prototypes"),
        ("[simulation.noise]\nkind = 'none'", "noise"),
        ("simulation = 3", "table of their own"),
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
