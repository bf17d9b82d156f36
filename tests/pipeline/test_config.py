"""Claims about the configuration: everything is checked before any work starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from softclose.config import CampaignConfig, ConfigError, canonical_json, known_keys, load_config


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
    changes = ["campaign.seed=2", "objective.level=0.95", "compute.chunk_switches=500", "population.name=modified"]
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
        ("waveform.max_volts=0", "greater than 0"),
        ("waveform.min_rise_us=2.5", "waveform.min_rise_us is 2.5"),
        ("waveform.initial=[[[0,2.5,3,100]]]", "waveform.initial.0.: pulse 1: pulse rises in 2.5 µs"),
        ("waveform.initial=[[[0,4,3,160]]]", "reaches 160 V; .* may not exceed 150 V"),
        ("model.horizon_us=inf", "finite"),
        ("compute.chunk_switches=1", "2000 chunks; at most 256"),
        ("campaign=3", "not of the form section.key=value"),
    ],
)
def test_a_bad_value_is_refused_by_name(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config({}, [override])


def test_every_problem_is_listed_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        load_config({}, ["campaign.seed=-1", "waveform.max_volts=0"])
    assert len(str(caught.value).splitlines()) == 2


def test_files_that_are_missing_or_malformed_are_told_with_their_path(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no configuration file at .*absent\.toml"):
        load_config(tmp_path / "absent.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("[campaign\nseed = 1\n")
    with pytest.raises(ConfigError, match=r"bad.toml is not valid TOML: .*line 1"):
        load_config(bad)


def test_a_population_file_is_found_beside_its_campaign(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\nbase = "current"\n')
    (tmp_path / "campaign.toml").write_text('[population]\nname = "mine.toml"\n')
    assert load_config(tmp_path / "campaign.toml").build_population().name == "mine"


def test_chunks_stay_bounded_whatever_the_ensemble() -> None:
    for n in (1, 999, 1000, 64_000, 10_000_000):
        config = load_config({}, [f"population.n_switches={n}"])
        assert -(-n // config.chunk_switches) <= 64


def test_the_automatic_chunk_size_is_written_out() -> None:
    """A store must not depend on what a later version would choose."""
    assert load_config({}, ["population.n_switches=500"]).to_dict()["compute"]["chunk_switches"] == 500
    assert load_config({}, ["population.n_switches=500000"]).to_dict()["compute"]["chunk_switches"] == 7813
    assert load_config({}, ["compute.chunk_switches=100"]).to_dict()["compute"]["chunk_switches"] == 100


def test_every_section_documents_its_keys() -> None:
    assert set(known_keys()) == {
        "campaign",
        "population",
        "model",
        "waveform",
        "objective",
        "optimiser",
        "explore",
        "finish",
        "compute",
        "store",
    }
