"""Claims about the configuration: everything is checked before any work starts."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from softclose.evaluate import respond
from softclose.plugins import EngineError
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig, ConfigError, canonical_json, known_keys, load_config
from softclose.settings.config import MOST_PROBLEMS
from softclose.waveform import Pulse, Waveform


def test_defaults_follow_from_an_empty_file() -> None:
    config = load_config({})
    assert config.waveform.space == "two-pulse-full"
    assert config.model.horizon_us == 250.0
    assert config.objective.c1_cm_s == 25.0


def test_plain_values_round_trip_with_their_fingerprint() -> None:
    config = load_config({}, ["campaign.seed=7", 'waveform.initial=[[[0,4,3,100],[20,5,"hold",80]]]'])
    again = CampaignConfig.from_dict(config.to_dict())
    assert again == config
    assert again.fingerprint() == config.fingerprint()
    assert canonical_json(again.to_dict()) == canonical_json(config.to_dict())


def test_any_setting_changes_the_fingerprint() -> None:
    base = load_config({}).fingerprint()
    changes = ["campaign.seed=2", "objective.level=0.95", "compute.block_switches=500", "population.name=modified"]
    assert len({base, *(load_config({}, [change]).fingerprint() for change in changes)}) == len(changes) + 1


def test_the_population_is_part_of_the_configuration(tmp_path: Path) -> None:
    """A campaign does not depend on a population file that may change or vanish."""
    config = load_config({}, ["population.name=modified"])
    data = config.to_dict() | {"population": config.to_dict()["population"] | {"name": "gone.toml"}}
    assert CampaignConfig.from_dict(data).build_population() == config.build_population()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("campaign.sed=7", "unknown key campaign.sed; did you mean campaign.seed"),
        ("campain.seed=7", "unknown section campain; did you mean campaign"),
        ("campaign.seed=x", "campaign.seed is 'x'"),
        ("campaign.budget=1.5", "campaign.budget is 1.5"),
        ("campaign.budget=true", "campaign.budget is True"),
        ("population.name=curent", "did you mean 'current'"),
        ("optimiser.engine=skop", "did you mean 'skopt'"),
        ("waveform.space=one-pulse", "waveform.space is 'one-pulse'"),
        (
            "waveform.max_volts=0",
            r"waveform.max_volts is 0; it must be a finite number from 1 to 1000 V \(default 150\)",
        ),
        ("waveform.max_volts=1e-3", "from 1 to 1000 V"),
        ("waveform.max_volts=1e9", "from 1 to 1000 V"),
        ("waveform.min_rise_us=0.01", "waveform.min_rise_us is 0.01; it must be a finite number from 0.05 to 1e.06 µs"),
        ("objective.level=2", "objective.level is 2; it must be a finite number above 0 and below 1"),
        ("objective.limits_cm_s=[5,-1]", "objective.limits_cm_s.1 is -1; it must be a finite number above 0 cm/s"),
        ("objective.limits_cm_s=5", "objective.limits_cm_s is 5; it must be a list, each entry a finite number"),
        ("population.sampling=sobl", "did you mean 'sobol'. it must be one of monte-carlo, sobol"),
        ("store.durable=3", "store.durable is 3; it must be true or false"),
        ("population.name=''", "population.name is ''; it must be a text that is not empty"),
        ("waveform.initial=[[[0,2.5,3,100]]]", "waveform.initial.0.: pulse 1 rises in 2.5 µs"),
        ("waveform.initial=[[[0,4,3,160]]]", "reaches 160 V; .* may not exceed 150 V"),
        ("model.horizon_us=inf", "finite"),
        ("compute.block_switches=1", "2000 blocks; at most 256"),
        ("model.name=reduced-order", "give model.modes, the TOML file of its modes"),
        ("model.modes=plate.toml", "has none: use reduced-order"),
        ("model.quality_factor=-2", "model.quality_factor is -2; it must be a finite number from 0 to 1e.09"),
        ("model.quality_factor=0.0005", "0 .no damping. or 0.001 and more"),
        ("model.film_width_um=3", "both film_length_um and film_width_um"),
        ("campaign=3", "not of the form section.key=value"),
    ],
)
def test_a_bad_value_is_refused_by_name(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config({}, [override])


def test_no_message_is_in_the_validator_s_words() -> None:
    for section, keys in known_keys().items():
        if section == "waveform":
            continue
        assert len(keys) <= MOST_PROBLEMS
        with pytest.raises(ConfigError) as caught:
            load_config({section: {key: [[]] for key in keys}})
        lines = str(caught.value).splitlines()
        assert len(lines) == len(keys)
        for line in lines:
            assert re.match(r"\w+\.\w+(\.0)? is .*; it must be ", line), line
            assert "nput" not in line
            assert "alid" not in line


def test_a_stored_configuration_is_read_without_its_plugins() -> None:
    stored = load_config({}).to_dict()
    stored["optimiser"]["engine"], stored["model"]["name"] = "their-own", "their-model"
    config = CampaignConfig.from_dict(stored)
    assert config.optimiser.engine == "their-own"
    with pytest.raises(EngineError, match="their-own"):
        config.check_plugins()
    with pytest.raises(ConfigError, match="their-own"):
        load_config(stored)
    revised = config.revised(["objective.level=0.5"])
    assert (revised.objective.level, revised.model.name) == (0.5, "their-model")


def test_the_unshaped_step_follows_the_limit() -> None:
    assert load_config({}).reference.step_volts == 100.0
    assert load_config("current", ["waveform.max_volts=90"]).reference.step_volts == 90.0
    assert load_config("current", ["waveform.max_volts=90", "reference.step_volts=80"]).reference.step_volts == 80.0


def fitted(tmp_path: Path, area: str = "plate_area_um2 = 15000.0") -> str:
    path = tmp_path / "mine.toml"
    path.write_text(f'name = "mine"\nbase = "current"\n{area}\n')
    return f"population.name={path}"


def test_a_campaign_inherits_the_plate_area_of_its_population(tmp_path: Path) -> None:
    config = load_config({}, [fitted(tmp_path)])
    assert config.model.plate_area_um2 == 15000.0
    again = CampaignConfig.from_dict(config.to_dict())
    assert again == config
    assert again.build_population().plate_area_um2 == 15000.0
    assert load_config({}, [fitted(tmp_path), "model.plate_area_um2=15000"]) == config


def test_a_plate_area_other_than_the_population_s_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"given as 16700 µm², but population 'mine' was fitted with 15000 µm²"):
        load_config({}, [fitted(tmp_path), "model.plate_area_um2=16700"])


def test_a_population_without_an_area_leaves_it_to_the_campaign() -> None:
    assert load_config({}).model.plate_area_um2 == 16700.0
    assert load_config({}, ["model.plate_area_um2=15000"]).model.plate_area_um2 == 15000.0
    assert "plate_area_um2" not in load_config({}).population_model


def test_every_problem_is_listed_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        load_config({}, ["campaign.seed=-1", "waveform.max_volts=0"])
    assert len(str(caught.value).splitlines()) == 2


def test_files_that_are_missing_or_malformed_are_told_with_their_path(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"the configuration .*absent\.toml cannot be read: there is no such file"):
        load_config(tmp_path / "absent.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("[campaign\nseed = 1\n")
    with pytest.raises(ConfigError, match=r"bad.toml is not valid TOML: .*line 1"):
        load_config(bad)


def test_a_population_file_is_found_beside_its_campaign(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\nbase = "current"\n')
    (tmp_path / "campaign.toml").write_text('[population]\nname = "mine.toml"\n')
    assert load_config(tmp_path / "campaign.toml").build_population().name == "mine"


def test_blocks_stay_bounded_whatever_the_ensemble() -> None:
    for n in (1, 999, 1000, 64_000, 10_000_000):
        config = load_config({}, [f"population.n_switches={n}"])
        assert -(-n // config.block_switches) <= 64


def test_the_automatic_block_size_is_written_out() -> None:
    """A store must not depend on what a later version would choose."""
    assert load_config({}, ["population.n_switches=500"]).to_dict()["compute"]["block_switches"] == 5120
    assert load_config({}, ["population.n_switches=500000"]).to_dict()["compute"]["block_switches"] == 7813
    assert load_config({}, ["compute.block_switches=100"]).to_dict()["compute"]["block_switches"] == 100


def test_every_section_documents_its_keys() -> None:
    assert set(known_keys()) == {
        "campaign",
        "population",
        "trim",
        "amplifier",
        "temperature",
        "model",
        "model_error",
        "waveform",
        "objective",
        "opening",
        "reference",
        "optimiser",
        "prior",
        "explore",
        "finish",
        "compute",
        "store",
    }


def test_a_device_with_a_faster_second_mode_may_have_faster_edges() -> None:
    own = ["waveform.min_rise_us=1.5", "waveform.initial=[[[0,2.5,3,100]]]"]
    config = load_config("current", own)
    space = Problem(config).space
    rises = [p.rise_us for w in space.waveforms(np.random.default_rng(1).random((200, space.dim))) for p in w.pulses]
    assert 1.5 <= min(rises) < 2.5
    slower = load_config("current", ["waveform.min_rise_us=8", "waveform.initial=[[[0,4.5,3,100]]]"])
    assert slower.waveform.least_rise_us == 4.0


def test_the_modes_are_written_out_and_their_file_is_needed_no_more(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("[[mode]]\nfrequency_kHz = 20\n[[mode]]\nfrequency_kHz = 90\nelectrode = 0.3\n")
    (tmp_path / "campaign.toml").write_text('[model]\nname = "reduced-order"\nmodes = "own.toml"\n')
    config = load_config(tmp_path / "campaign.toml")
    (tmp_path / "own.toml").unlink()
    again = CampaignConfig.from_dict(config.to_dict())
    assert again == config
    assert [m.frequency_kHz for m in again.build_reduced_order().mode] == [20.0, 90.0]
    other = config.to_dict()
    other["reduced_order_model"]["mode"][1]["electrode"] = 0.2
    assert CampaignConfig.from_dict(other).fingerprint() != config.fingerprint()


def test_losses_reach_every_evaluation() -> None:
    waveform = Waveform([Pulse(0, 4, math.inf, 100)])
    switches = load_config({}).build_population().sample(20, seed=1)
    plain = respond(load_config({}), switches, waveform)
    damped = respond(load_config({}, ["model.quality_factor=5"]), switches, waveform)
    assert (damped.max_contact_speed < 0.99 * plain.max_contact_speed).all()
    modes = respond(load_config("current-two-modes"), switches, waveform)
    assert modes.mode_peak_um is not None
    assert modes.mode_peak_um.shape == (20, 2)


def test_a_path_in_an_override_is_from_here_and_one_in_a_file_from_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    for place in ("here", "there"):
        (tmp_path / place / "lot.toml").write_text(f'base = "current"\nname = "from {place}"\n')
    (tmp_path / "there" / "own.toml").write_text('[population]\nname = "lot.toml"\n')
    monkeypatch.chdir(tmp_path / "here")
    assert load_config("../there/own.toml").build_population().name == "from there"
    own = load_config("../there/own.toml", ["population.name=lot.toml"])
    assert own.build_population().name == "from here"


@pytest.mark.parametrize("how", ["beside its file", "absolute", "from here", "home"])
def test_the_folder_that_one_stands_in_is_no_part_of_a_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    modes = Path(__file__).parents[2] / "pipeline/softclose/presets/modes/plate.toml"
    (tmp_path / "elsewhere").mkdir()
    for folder in (tmp_path, tmp_path / "elsewhere"):
        (folder / "lot.toml").write_text('base = "current"\nname = "mine"\n')
        (folder / "modes.toml").write_text(modes.read_text())
    table = '[population]\nname = "{0}lot.toml"\n[model]\nname = "reduced-order"\nmodes = "{0}modes.toml"\n'
    (tmp_path / "own.toml").write_text(table.format(""))
    (tmp_path / "absolute.toml").write_text(table.format(f"{tmp_path}/"))
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "home.toml").write_text(table.format("~/"))
    monkeypatch.chdir(tmp_path)
    here = load_config("own.toml")
    monkeypatch.chdir(tmp_path / "elsewhere")
    there = {
        "beside its file": lambda: load_config("../own.toml"),
        "absolute": lambda: load_config(tmp_path / "absolute.toml"),
        "from here": lambda: load_config("../own.toml", ["population.name=lot.toml", "model.modes=./modes.toml"]),
        "home": lambda: load_config("~/home.toml"),
    }[how]()
    assert there.fingerprint() == here.fingerprint()
    assert (there.population.name, there.model.modes) == ("lot.toml", "modes.toml")
    again = CampaignConfig.from_dict(there.to_dict())
    assert again.revised(["campaign.seed=3"]).build_population().name == "mine"
    assert str(tmp_path) not in canonical_json(there.to_dict())
