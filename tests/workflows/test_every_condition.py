"""Every analysis of a store under every condition, held against switches that are simulated by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from _pytest.mark import ParameterSet

import by_hand
from conditions_of_campaigns import CONDITIONS, DRIVE, merged
from small_campaigns import finish
from softclose.evaluate import judge
from softclose.settings import CampaignConfig, load_config
from softclose_store import open_campaign, verify
from softclose_workflows.analyses.assessed_trace import assess_trace
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.drive_errors import sensitivity, tolerance
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.analyses.opening import opening
from softclose_workflows.analyses.recompute import replay
from softclose_workflows.analyses.references import reference_designs
from softclose_workflows.analyses.rescore import Score, rescore
from softclose_workflows.analyses.tails import questions, tails
from softclose_workflows.report.comparison import differences, read_entries
from softclose_workflows.report.gather import gather
from softclose_workflows.run.creation import create_store

TINY = {
    "campaign": {"budget": 3},
    "prior": {"model": "none"},
    "population": {"name": "current", "n_switches": 12},
    "optimiser": {"engine": "sobol"},
    "waveform": {
        "initial": [[[p.start_us, p.rise_us, "hold" if p.holds else p.peak_us, p.volts] for p in DRIVE.pulses]]
    },
    "store": {"n_times": 6, "max_impacts": 4},
}
FRESH = 40


def close(found, wanted) -> None:  # type: ignore[no-untyped-def]
    """Speeds to 2e-3 cm/s, of all but a few that graze."""
    v, w = np.asarray(found.max_contact_speed) * 100.0, np.asarray(wanted.max_contact_speed) * 100.0
    apart = ~((np.abs(v - w) < 2e-3) | (np.isnan(v) & np.isnan(w)))
    assert apart.sum() <= 2, (v[apart], w[apart])
    assert (np.asarray(found.closed) != wanted.closed).sum() <= 1


SHORT = ("trim by both", "slew and resolution", "worst temperature", "quality factor")
"""Conditions of `make test`: of trim, amplifier, temperature and losses; all of them in `make long`."""


def of_conditions(short: Sequence[str]) -> list[ParameterSet]:
    """All of them, those that are not short in `make long`."""
    return [pytest.param(n, marks=() if n in short else pytest.mark.long, id=n) for n in CONDITIONS]


TWO = pytest.mark.parametrize("campaign", of_conditions(SHORT[::3]), indirect=True)
"""For analyses of a store that `make test` tries under two of them."""


@pytest.fixture(scope="module", params=of_conditions(SHORT))
def campaign(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, CampaignConfig]:
    """A tiny campaign under each condition, run to its end in this process, its best certified."""
    data = {k: dict(v) for k, v in TINY.items()}
    for section, keys in merged(request.param).items():
        data[section] = data.get(section, {}) | keys
    config = load_config(data)
    path: Path = tmp_path_factory.mktemp("conditions") / "a.zarr"
    create_store(config, str(path))
    finish(path)
    certify(str(path), n_switches=FRESH, top=1)
    return str(path), config


def test_a_run_stores_what_each_switch_did_and_the_columns_of_its_lot(campaign: tuple[str, CampaignConfig]) -> None:
    path, config = campaign
    stored = open_campaign(path)
    rows = by_hand.rows(config, 12, seed=config.campaign.seed, sampling=config.population.sampling)
    names = {
        "a": "voltage_scale",
        "b": "time_scale",
        "gain": "gain",
        "clock": "clock",
        "force_error": "force_error",
        "D": "D",
        "K": "K",
        "M": "M",
    }
    population = stored.population()
    for key, name in names.items():
        assert (key in rows[0]) == (name in population)
        if key in rows[0]:
            np.testing.assert_allclose(population[name], [row[key] for row in rows], rtol=1e-6)
    wanted = by_hand.respond(config, rows, DRIVE)
    close(stored.responses(0), wanted)
    g = judge(config, stored.responses(0)).g_cm_s
    assert stored.records()["g_cm_s"][0] == g
    assert g == pytest.approx(judge(config, wanted).g_cm_s, abs=2.2)  # a switch that grazes may close or not
    assert verify(path).ok
    assert replay(path, 3).ok


@TWO
def test_a_certificate_is_of_switches_and_references_under_the_conditions(campaign: tuple[str, CampaignConfig]) -> None:
    path, config = campaign
    found = certify(path, n_switches=FRESH, top=1)
    rows = by_hand.rows(config, FRESH, seed=config.campaign.seed, stream=1)
    close(found.best.response, by_hand.respond(config, rows, found.best.waveform))
    designs = reference_designs(config).designs
    assert {d.name for d in found.references} == {*designs}
    for reference in found.references:
        close(reference.response, by_hand.respond(config, rows, designs[reference.name], tailored=False))


@TWO
def test_a_race_runs_on_the_very_same_switches(campaign: tuple[str, CampaignConfig]) -> None:
    path, _ = campaign
    raced, _ = certify_within(path, 50.0, n_switches=FRESH, top=1)
    wanted = certify(path, n_switches=FRESH, top=1)
    assert raced.best.assessment == wanted.best.assessment


@pytest.mark.parametrize("campaign", of_conditions([n for n in SHORT if n != "quality factor"]), indirect=True)
def test_a_trace_of_a_drive_does_what_the_drive_does_where_nothing_is_tailored(
    campaign: tuple[str, CampaignConfig],
) -> None:
    """With losses in `make long`: a kernel of its own has to be compiled for them."""
    from softclose import Trace

    path, config = campaign
    t = np.linspace(0.0, 250.0, 251)
    found = assess_trace(path, Trace(t, DRIVE.voltage(t)), n_switches=FRESH)
    rows = by_hand.rows(config, FRESH, seed=config.campaign.seed, stream=1)
    close(found.response, by_hand.respond(config, rows, Trace(t, DRIVE.voltage(t)), tailored=False))


def test_rescoring_with_the_campaign_s_own_objective_changes_nothing(campaign: tuple[str, CampaignConfig]) -> None:
    path, _ = campaign
    table = open_campaign(path).records()
    for row in rescore(path, Score()):
        assert row.assessment.g_cm_s == table["g_cm_s"][row.candidate]
        assert row.rank == row.rank_before
    sooner = rescore(path, Score(closed_by_us=1.0))
    assert all(row.assessment.p_nc == 1.0 for row in sooner), "nothing is held after a microsecond"


@TWO
def test_a_campaign_compared_with_itself_is_no_softer_and_the_report_shows_the_same(
    campaign: tuple[str, CampaignConfig],
) -> None:
    path, config = campaign
    entries = read_entries([path, path], fresh=FRESH)
    ((_, _, pair),) = differences(entries)
    assert pair.v_u_cm_s == pair.p_nc == 0.0
    fresh = certify(path, n_switches=FRESH, top=1).best
    assert entries[0].design is not None
    np.testing.assert_array_equal(entries[0].design.speed_cm_s, fresh.response.max_contact_speed * 100.0)
    data = gather(path)
    trained_on = by_hand.rows(config, 12, seed=config.campaign.seed, sampling=config.population.sampling)
    own = by_hand.respond(config, trained_on, data.designs[0].waveform).max_contact_speed
    assert (np.abs(np.nan_to_num(data.designs[0].speed_cm_s) - 100.0 * np.nan_to_num(own)) > 2e-3).sum() <= 1


@TWO
def test_drive_errors_and_rare_failures_are_asked_of_the_lot_under_its_conditions(
    campaign: tuple[str, CampaignConfig],
) -> None:
    path, config = campaign
    chosen, rows = tolerance(path, n_switches=FRESH)
    assert rows[0].assessment == certify(path, n_switches=FRESH, top=1).best.assessment
    _, ((_, (tail,)),) = tails(path, questions([25.0], False), methods=["brute"], n_switches=60)
    hand = by_hand.respond(config, by_hand.rows(config, 60, seed=0, stream=2), chosen.waveform)
    assert tail.probability == pytest.approx(np.nanmean(np.nan_to_num(hand.max_contact_speed) > 0.25), abs=1.01 / 60)
    _, shares = sensitivity(path, points=8, replicates=2)
    assert len(shares.indices) >= 8


@TWO
def test_a_stored_design_opens_under_its_conditions(campaign: tuple[str, CampaignConfig]) -> None:
    from softclose.opening import OpeningError

    path, _ = campaign
    config = campaign[1]
    rows = by_hand.rows(config, FRESH, seed=config.campaign.seed, stream=1)
    best = certify(path, n_switches=FRESH, top=1).best
    held = int(by_hand.respond(config, rows, best.waveform).closed.sum())
    if held < 9:
        with pytest.raises(OpeningError, match="are held when the fall begins"):
            opening(path, n_switches=FRESH)
    elif held > 11:
        assert abs(opening(path, n_switches=FRESH).openings.plain.n - held) <= 2
