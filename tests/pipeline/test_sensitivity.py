"""Sobol' indices: exact on made-up device models, sensible on the real one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softclose import load_population
from softclose.baselines import unshaped
from softclose.population import PopulationError
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig, load_config
from softclose.uncertainty import sensitivity as module
from softclose.uncertainty.sensitivity import SensitivityError, sensitivity

CURRENT = load_population("current")


def _linear(config: object, lot: Lot, waveform: object) -> Any:
    """V = D + 2 G, closed where D is below its median: a model with known indices."""
    d, g = lot["D"], lot["G"]
    return SimpleNamespace(max_contact_speed=d + 2.0 * g, closed=d < 2.42, status=np.zeros(len(d)))


def test_indices_of_an_additive_model_are_its_variance_shares(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "respond", _linear)
    s = sensitivity(CURRENT, unshaped(), n=512)
    share = CURRENT.D.sd**2 / (CURRENT.D.sd**2 + 4.0 * CURRENT.G.sd**2)
    exact = {("v_cm_s", "D"): share, ("v_cm_s", "G"): 1.0 - share, ("closed", "D"): 1.0}
    for i in s.indices:
        truth = exact.get((i.output, i.variable), 0.0)
        assert i.first == pytest.approx(truth, abs=0.03)
        assert i.total == pytest.approx(truth, abs=0.03)
    assert s.p_contact == 1.0
    assert s.p_closed == pytest.approx(0.5, abs=0.1)
    assert s.n_simulated == 6 * 512 * 8


def test_a_switch_that_never_touches_counts_as_0_and_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def sometimes(config: object, lot: Lot, waveform: object) -> Any:
        touches = lot["G"] < 3.67
        v = np.where(touches, 0.2, np.nan)
        return SimpleNamespace(max_contact_speed=v, closed=np.ones(len(lot), bool), status=np.zeros(len(lot)))

    monkeypatch.setattr(module, "respond", sometimes)
    s = sensitivity(CURRENT, unshaped(), n=256, n_replicates=3)
    found = {(i.output, i.variable): i for i in s.indices}
    assert found["v_cm_s", "G"].first == pytest.approx(1.0, abs=0.05)
    assert 0.3 < s.p_contact < 0.7
    assert np.isnan(found["closed", "G"].first)  # every switch closes: nothing to explain


def test_thickness_dominates_the_unshaped_contact_speed() -> None:
    s = sensitivity(CURRENT, unshaped(), n=64, n_replicates=4, seed=2)
    v = {i.variable: i for i in s.indices if i.output == "v_cm_s"}
    assert max(v, key=lambda name: v[name].total) == "T"
    assert v["T"].first_interval[0] < v["T"].first < v["T"].first_interval[1]
    again = sensitivity(CURRENT, unshaped(), n=64, n_replicates=4, seed=2)
    assert [i.total for i in again.indices[:4]] == [i.total for i in s.indices[:4]]


def test_sizes_that_give_no_indices_are_refused() -> None:
    with pytest.raises(SensitivityError, match="n is 100; it must be a power of 2"):
        sensitivity(CURRENT, unshaped(), n=100)
    with pytest.raises(SensitivityError, match="n_replicates is 1"):
        sensitivity(CURRENT, unshaped(), n_replicates=1)


def test_a_fitted_population_is_asked_on_its_own_plate_area(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[float] = []

    def noted(config: CampaignConfig, lot: Lot, waveform: object) -> Any:
        used.append(config.model.plate_area_um2)
        return _linear(config, lot, waveform)

    monkeypatch.setattr(module, "respond", noted)
    fitted = replace(CURRENT, plate_area_um2=15000.0)
    sensitivity(fitted, unshaped(), n=2, n_replicates=2)
    assert set(used) == {15000.0}
    with pytest.raises(PopulationError, match="fitted with 15000 µm²"):
        sensitivity(fitted, unshaped(), n=2, n_replicates=2, config=load_config({}))


def test_what_conditions_draw_has_indices_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """An additive model of a gap, a gain, a clock, a temperature and a voltage scale, whose shares are known."""
    config = load_config(
        {
            "trim": {"measured": "pull-in", "pull_in_error": 0.1},
            "amplifier": {"gain_error": 0.02, "time_error": 0.01},
            "temperature": {"celsius": [-40, 85], "stiffness": [1.0, 1.0], "low_C": -40, "high_C": 85},
        }
    )

    def additive(config: object, lot: Lot, waveform: object) -> Any:
        v = lot["gain"] - 1.0 + 3.0 * (lot["clock"] - 1.0) + 1e-4 * lot["celsius"]
        return SimpleNamespace(max_contact_speed=v, closed=lot["gain"] < 1.0, status=np.zeros(len(lot)))

    monkeypatch.setattr(module, "respond", additive)
    s = sensitivity(CURRENT, unshaped(), n=512, n_replicates=4, config=config)
    parts = np.array([0.02**2, 0.03**2, (1e-4 * 125.0) ** 2 / 12.0])
    shares = dict(zip(("gain", "clock", "temperature"), parts / parts.sum(), strict=True))
    names = [i.variable for i in s.indices if i.output == "v_cm_s"]
    assert names == [*CURRENT.variables, "error of pull-in voltage", "error of resonance", *shares]
    for i in s.indices:
        truth = shares.get(i.variable, 0.0) if i.output == "v_cm_s" else float(i.variable == "gain")
        assert i.first == pytest.approx(truth, abs=0.03)
        assert i.total == pytest.approx(truth, abs=0.03)
    assert s.n_simulated == (9 + 2) * 512 * 4


def test_a_drive_of_its_own_takes_the_lot_s_share_and_leaves_that_of_gain() -> None:
    """On the shipped model: with scales that are known exactly, less is left of the lot, and more of errors of gain."""
    exact = {"trim": {"measured": "pull-in and resonance", "pull_in_error": 0.0, "resonance_error": 0.0}}
    shares = []
    for settings in ({}, exact):
        config = load_config(settings | {"amplifier": {"gain_error": 0.05}})
        s = sensitivity(CURRENT, unshaped(), n=64, n_replicates=4, seed=2, config=config)
        shares.append({i.variable: i.total for i in s.indices if i.output == "v_cm_s"})
        assert shares[-1]["clock"] == pytest.approx(0.0, abs=1e-9)
    assert shares[1]["T"] < 0.6 * shares[0]["T"]
    assert shares[1]["gain"] > 1.5 * shares[0]["gain"]


def test_closing_too_late_is_a_failure_to_close() -> None:
    early, late = (
        sensitivity(CURRENT, unshaped(), n=32, n_replicates=2, config=load_config({"objective": {"closed_by_us": t}}))
        for t in (1.0, 0.0)
    )
    assert early.p_closed == 0.0
    assert late.p_closed > 0.9


def test_correlated_variables_have_indices_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of V = D + 2 G + T / 20 with D and G correlated: the share of both is that of the variance of D + 2 G."""

    def linear(config: object, lot: Lot, waveform: object) -> Any:
        v = lot["D"] + 2.0 * lot["G"] + 0.05 * lot["T"]
        return SimpleNamespace(max_contact_speed=v, closed=lot["D"] < 2.42, status=np.zeros(len(lot)))

    monkeypatch.setattr(module, "respond", linear)
    lot = replace(CURRENT, correlation=(("D", "G", 0.8),))
    s = sensitivity(lot, unshaped(), n=512)
    drawn = lot.sample_parameters(200_000, seed=7)
    both, alone = float(np.var(drawn[:, 0] + 2.0 * drawn[:, 1])), float(np.var(0.05 * drawn[:, 3]))
    assert both > 1.2 * float(np.var(drawn[:, 0]) + 4.0 * np.var(drawn[:, 1])), "the correlation matters here"
    exact = {("v_cm_s", "D and G"): both / (both + alone), ("v_cm_s", "T"): alone / (both + alone)}
    exact |= {("closed", "D and G"): 1.0}
    assert [i.variable for i in s.indices if i.output == "closed"] == ["D and G", "E", "T"]
    for i in s.indices:
        truth = exact.get((i.output, i.variable), 0.0)
        assert i.first == pytest.approx(truth, abs=0.03), i
        assert i.total == pytest.approx(truth, abs=0.03), i


@pytest.mark.parametrize(
    ("pairs", "groups"),
    [
        ((), ["D", "G", "U_pi", "f"]),
        ((("G", "U_pi", 0.7),), ["D", "G and U_pi", "f"]),
        ((("D", "f", -0.5), ("G", "U_pi", 0.7)), ["D and f", "G and U_pi"]),
        ((("D", "G", 0.3), ("f", "G", 0.4)), ["D and G and f", "U_pi"]),
        ((("D", "G", 0.0),), ["D", "G", "U_pi", "f"]),
    ],
)
def test_a_lot_told_by_pull_in_and_resonance_has_indices(
    tmp_path: Path, pairs: tuple[tuple[str, str, float], ...], groups: list[str]
) -> None:
    lines = ['name = "al"', "plate_area_um2 = 12000.0"]
    for name, low, high in (("D", 1.49, 1.59), ("G", 2.46, 2.57), ("U_pi", 19.2, 21.5), ("f", 59.9, 63.3)):
        lines += [
            f"[{name}]",
            'distribution = "beta"',
            f"lower = {low}",
            f"upper = {high}",
            "alpha = 2.0",
            "beta = 2.0",
        ]
    lines += ["[correlation]", *(f"{a}-{b} = {rho}" for a, b, rho in pairs)] if pairs else []
    (tmp_path / "al.toml").write_text("\n".join(lines) + "\n")
    lot = load_population(tmp_path / "al.toml")
    s = sensitivity(lot, unshaped(26.0), n=32, n_replicates=2)
    assert [i.variable for i in s.indices if i.output == "v_cm_s"] == groups
    assert s.p_contact > 0.9
    assert sum(i.total for i in s.indices if i.output == "v_cm_s") > 0.7


def test_a_lot_of_devices_with_k_and_m_of_their_own_has_indices(tmp_path: Path) -> None:
    mean = CURRENT.mean_switch
    text = 'name = "own"\nbase = "current"\n'
    for name, value in (("K", mean[2]), ("M", mean[3])):
        values = [float(value) * f for f in (0.9, 0.95, 1.0, 1.05, 1.1)]
        text += f"[{name}]\ndistribution = 'empirical'\nvalues = {values}\n"
    (tmp_path / "own.toml").write_text(text)
    s = sensitivity(load_population(tmp_path / "own.toml"), unshaped(), n=32, n_replicates=2)
    assert [i.variable for i in s.indices if i.output == "v_cm_s"] == ["D", "G", "K", "M"]
