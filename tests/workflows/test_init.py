"""Claims about starting: what `init` writes runs and suits its lot, the schema agrees with the reader, a dry run writes
nothing."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from softclose import load_config
from softclose.evaluate.chain import chain_of
from softclose.population import load_population, population_names
from softclose.presets import preset_names
from softclose.settings import ConfigError, known_keys
from softclose.settings.json_schema import configuration_schema
from softclose_workflows.analyses.starting import EFFORTS, Start, explained, n_trajectories, starting_file
from softclose_workflows.cli import main

SCHEMA = configuration_schema()
OWN_LOT = str(files("softclose.presets").joinpath("populations/cantilever.toml"))


@pytest.mark.parametrize("population", population_names())
@pytest.mark.parametrize("effort", [*EFFORTS])
@pytest.mark.parametrize("n_pulses", [2, 3])
def test_the_file_is_a_campaign_for_its_lot(population: str, effort: Any, n_pulses: Any) -> None:
    text = starting_file(Start(name='a "quoted" name', population=population, n_pulses=n_pulses, effort=effort))
    config = load_config(tomllib.loads(text))
    assert config.campaign.name == 'a "quoted" name'
    assert config.population.name == population
    assert config.waveform.space.startswith({2: "two", 3: "three"}[n_pulses])
    assert config.waveform.max_volts > load_population(population).summary()["U_pi_upper_V"]
    assert config.objective.max_open == config.objective.warn_open == 0.02
    assert (config.model_error.force, config.model_error.time, config.n_cases) == (0.02, 0.01, 1)
    assert list(Draft202012Validator(SCHEMA).iter_errors(tomllib.loads(text))) == []


def test_a_preset_for_an_own_lot_does_not_take_its_model_for_right() -> None:
    """The published study's presets do, which reproduce it."""
    own = {n for n in preset_names() if load_config(n).population.name not in population_names()}
    assert {"actuator", "cantilever", "capacitive"} <= own
    assert {n for n in preset_names() if not load_config(n).model_error.none} == own


def test_numbers_in_the_comments_are_the_lot_s() -> None:
    text, lot = starting_file(Start()), load_population("current").summary()
    assert f"pulls in at {lot['U_pi_mean_switch_V']:.1f} V" in text
    assert f"between {lot['U_pi_lower_V']:.1f} and {lot['U_pi_upper_V']:.1f} V" in text
    assert "NOT enough" not in text
    assert "NOT enough" in starting_file(Start(max_volts=lot["U_pi_upper_V"] - 1.0))
    assert "MORE than a quarter" in starting_file(Start(min_rise_us=20.0))
    slow = load_config(tomllib.loads(starting_file(Start())))
    period = 45.4  # µs, of K = 65.3 N/m and M = 3.41 µg
    assert 6.0 * period <= slow.model.horizon_us <= 6.0 * period + 10.0


@pytest.mark.parametrize("population", [*population_names(), OWN_LOT])
def test_hold_is_limited_so_that_the_weakest_switch_keeps_a_tenth_of_it(population: str) -> None:
    """Where the margin is just kept by 90 %, the certificate has nothing to warn of."""
    config = load_config(tomllib.loads(starting_file(Start(population=population))))
    margin = config.objective.quantity_limits["hold_margin"]
    release = load_population(population).sample(20_000, seed=5)
    release = chain_of(config).device.holding_voltage(release)
    held = margin + np.quantile(release, 0.9)
    assert 0.05 < (held - release.max()) / held < 0.12
    assert held < config.waveform.max_volts


def test_an_amplifier_that_cannot_hold_with_room_is_told_of() -> None:
    lot = load_population("current").summary()
    text = starting_file(Start(max_volts=lot["U_pi_mean_switch_V"]))
    assert "at max_volts, which is LITTLE" in text
    assert 0.0 <= tomllib.loads(text)["objective"]["quantity_limits"]["hold_margin"] < lot["U_pi_mean_switch_V"] - 60.0


def test_the_command_writes_asks_nothing_without_a_terminal_and_replaces_nothing(tmp_path: Path) -> None:
    target = tmp_path / "mine.toml"
    done = CliRunner().invoke(main, ["init", str(target), "--pulses", "3", "--max-open", "0.01"])
    assert done.exit_code == 0, done.output
    assert load_config(str(target)).objective.max_open == 0.01
    before = target.read_text()
    again = CliRunner().invoke(main, ["init", str(target)])
    assert (again.exit_code, target.read_text()) == (2, before)
    assert "--force" in again.output
    assert CliRunner().invoke(main, ["init", str(target), "--force"]).exit_code == 0
    assert target.read_text() != before
    assert CliRunner().invoke(main, ["init"]).exit_code == 2


def preset_tables() -> Iterator[Any]:
    for name in preset_names():
        yield pytest.param(tomllib.loads(files("softclose.presets").joinpath(f"{name}.toml").read_text()), id=name)


@pytest.mark.parametrize("table", [*preset_tables()])
def test_every_preset_keeps_the_schema(table: dict[str, Any]) -> None:
    Draft202012Validator.check_schema(SCHEMA)
    assert list(Draft202012Validator(SCHEMA).iter_errors(table)) == []


def test_the_schema_has_every_key_with_its_meaning_and_no_other(tmp_path: Path) -> None:
    target = tmp_path / "s.json"
    assert CliRunner().invoke(main, ["init", "--schema", str(target)]).exit_code == 0
    written = json.loads(target.read_text())
    assert written == json.loads(json.dumps(SCHEMA))  # tuples are lists in a file
    for section, keys in known_keys().items():
        (name,) = [part for part in SCHEMA["properties"][section].values() if str(part).startswith("#/$defs/")]
        table = SCHEMA["$defs"][name.removeprefix("#/$defs/")]["properties"]
        assert sorted(table) == sorted(keys)
        assert all(len(table[key]["description"]) > 10 for key in keys)
    assert sorted(SCHEMA["properties"]) == sorted(known_keys())


@pytest.mark.parametrize(
    "wrong",
    [
        {"campain": {}},
        {"campaign": {"seeed": 1}},
        {"campaign": {"seed": -1}},
        {"campaign": {"budget": "many"}},
        {"population": {"sampling": "dice"}},
        {"objective": {"level": 1.5}},
        {"waveform": {"max_volts": -3.0}},
        {"trim": {"bins": 5000}},
        {"model": {"restitution": 2.0}},
    ],
)
def test_what_the_reader_refuses_of_one_key_the_schema_refuses_too(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        load_config(wrong)
    assert list(Draft202012Validator(SCHEMA).iter_errors(wrong))


def test_a_dry_run_says_what_it_would_take_and_writes_nothing(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    done = CliRunner().invoke(main, ["run", "current-three", "--store", str(store), "--dry-run", "--serial"])
    assert done.exit_code == 0, done.output
    config = load_config("current-three")
    for line in explained(config):
        assert line in done.output
    assert f"{config.total_budget:,} candidates, {n_trajectories(config):,} trajectories" in done.output
    assert "nothing was written" in done.output
    assert not store.exists()
    assert list(tmp_path.iterdir()) == []


def test_trajectories_count_every_wave_and_every_temperature() -> None:
    config = load_config("current", ["finish.budget=0", "explore.budget=0"])
    assert n_trajectories(config) == config.campaign.budget * config.population.n_switches
    worst = load_config("current-temperature")
    waves = worst.temperature.worst_of
    assert waves > 1
    assert n_trajectories(worst) % waves == 0
