"""What an open switch costs belongs to the lot: prices, limits and the step of another one are not the paper's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softclose.baselines import unshaped
from softclose.evaluate import draw, evaluate
from softclose.population import load_population
from softclose.settings import ConfigError, load_config
from softclose.settings.scaled import PUBLISHED, PUBLISHED_V_U_CM_S, STEP, rounded
from softclose.switch.plate import closing_voltage

SPEEDS = ("c1_cm_s", "undefined_v_u_cm_s", "chance_penalty_cm_s")


def another_lot(folder: Path, *, stiffer: float = 1.0, lighter: float = 1.0) -> Path:
    """The shipped lot with springs `stiffer` times as stiff and plates `lighter` times as light, by a law."""
    current = load_population("current")
    mean = current.mean_switch
    e, t = (0.5 * (v.lower + v.upper) for v in (current.E, current.T))
    path = folder / f"lot-{stiffer:g}-{lighter:g}.toml"
    path.write_text(
        f'name = "another"\nbase = "current"\n[law]\nK = "{stiffer * mean[2]} * E / {e}"\n'
        f'M = "{mean[3] / lighter} * T / {t}"\n'
    )
    return path


@pytest.mark.parametrize(("stiffer", "lighter"), [(1.0, 1.0), (0.5, 1.0), (1.5, 1.0), (1.0, 25.0), (1.5, 9.0)])
def test_prices_and_limits_are_in_proportion_to_the_v_u_of_the_lot_under_its_step(
    tmp_path: Path, stiffer: float, lighter: float
) -> None:
    path = another_lot(tmp_path, stiffer=stiffer, lighter=lighter)
    config = load_config({"population": {"name": str(path)}, "waveform": {"max_volts": 300.0}})
    population = config.build_population()
    pull_in = float(closing_voltage(population.mean_switch, config.model.plate_area_um2))
    step = config.reference.step_volts
    assert step == pytest.approx(STEP * pull_in, rel=5e-3)
    fresh = draw(config, 40_000, seed=9)
    found = evaluate(config, fresh, unshaped(step), fresh=True)
    part = found.v_u_cm_s / PUBLISHED_V_U_CM_S
    for name in SPEEDS:
        assert getattr(config.objective, name) == pytest.approx(part * PUBLISHED[name], rel=0.02)
    (limit,) = config.objective.limits_cm_s
    assert limit == pytest.approx(part * 19.7, rel=0.02)


def test_lighter_switches_are_faster_and_their_open_ones_dearer(tmp_path: Path) -> None:
    """At a twenty-fifth of the mass the same voltages close it five times as fast: exact, by the scaling of Eq. 1."""
    prices = []
    for lighter, horizon in ((1.0, 250.0), (25.0, 50.0)):
        name = str(another_lot(tmp_path, lighter=lighter))
        prices.append(load_config({"population": {"name": name}, "model": {"horizon_us": horizon}}).objective.c1_cm_s)
    assert prices[1] == pytest.approx(5.0 * prices[0], rel=0.01)


def test_the_papers_own_lot_has_about_the_papers_own_figures() -> None:
    found = load_config({}).objective
    assert found.c1_cm_s == pytest.approx(25.0, rel=0.02)
    assert found.undefined_v_u_cm_s == pytest.approx(60.0, rel=0.02)
    assert found.limits_cm_s == (pytest.approx(19.7, rel=0.02),)
    assert (found.max_open, found.warn_open) == (0.1, 0.05)


def test_what_is_given_is_kept_and_what_was_written_out_does_not_change_again(tmp_path: Path) -> None:
    lot = {"population": {"name": str(another_lot(tmp_path, lighter=25.0))}}
    own = load_config(lot | {"objective": {"c1_cm_s": 3.0, "limits_cm_s": []}, "reference": {"step_volts": 7.0}})
    assert (own.objective.c1_cm_s, own.objective.limits_cm_s, own.reference.step_volts) == (3.0, (), 7.0)
    assert own.objective.undefined_v_u_cm_s > 100.0
    again = type(own).from_dict(own.to_dict())
    assert again.fingerprint() == own.fingerprint()
    revised = own.revised(["model.restitution=0.3", "waveform.max_volts=60"])
    assert revised.objective == own.objective


def test_a_lot_that_its_step_leaves_open_is_asked_for_numbers(tmp_path: Path) -> None:
    low = {"waveform": {"max_volts": 40.0}}
    with pytest.raises(ConfigError, match=r"40 V .* too few switches .* give objective\.c1_cm_s, .*max_volts") as found:
        load_config(low)
    assert "\n" not in str(found.value)
    numbers = {"c1_cm_s": 10.0, "undefined_v_u_cm_s": 30.0, "chance_penalty_cm_s": 200.0, "limits_cm_s": [8.0]}
    config = load_config(low | {"objective": numbers})
    assert (config.objective.c1_cm_s, config.reference.step_volts) == (10.0, 40.0)


def test_the_scale_is_that_of_the_device_model() -> None:
    plain = load_config({})
    damped = load_config({"model": {"quality_factor": 1.0}})
    assert damped.objective.c1_cm_s < 0.95 * plain.objective.c1_cm_s
    preset = Path(__file__).parents[2] / "pipeline/softclose/presets/modes/plate.toml"
    modal = load_config({"model": {"name": "reduced-order", "modes": str(preset)}})
    assert modal.objective.c1_cm_s != plain.objective.c1_cm_s


@pytest.mark.parametrize("source", ["current", "current-two", "modified", "process-improved", "current-yield"])
def test_presets_of_the_papers_lots_spell_out_its_figures(source: str) -> None:
    found = load_config(source)
    assert found.objective.c1_cm_s == 25.0
    assert found.objective.undefined_v_u_cm_s == 60.0
    assert found.objective.limits_cm_s == (19.7,)
    assert found.objective.max_open == 1.0
    assert found.reference.step_volts == 100.0


@pytest.mark.parametrize("source", ["current", "current-three", "current-front", "current-yield"])
def test_a_presets_figures_do_not_follow_it_to_another_lot(tmp_path: Path, source: str) -> None:
    name = f"population.name={another_lot(tmp_path, lighter=25.0)}"
    own = load_config({"population": {"name": name.partition("=")[2]}})
    found = load_config(source, [name])
    for key in ("c1_cm_s", "undefined_v_u_cm_s", "limits_cm_s", "max_open"):
        assert getattr(found.objective, key) == getattr(own.objective, key), key
    assert found.reference.step_volts == own.reference.step_volts
    kept = load_config(source, [name, "objective.c1_cm_s=7.5", "objective.max_open=0.3", "reference.step_volts=90"])
    assert (kept.objective.c1_cm_s, kept.objective.max_open, kept.reference.step_volts) == (7.5, 0.3, 90.0)


def test_a_limit_on_open_switches_beyond_what_ranks_is_refused() -> None:
    chance: dict[str, Any] = {"form": "chance", "p_max": 0.2}
    with pytest.raises(ConfigError, match=r"p_max is 0\.2 and objective\.max_open 0\.1: .*raise max_open"):
        load_config({"objective": chance})
    assert load_config({"objective": chance | {"max_open": 0.2}}).objective.p_max == 0.2


@pytest.mark.parametrize("value", [24.9549, 25.0451, 0.0123456, 123456.7, 1.0])
def test_a_figure_has_three_digits(value: float) -> None:
    found = rounded(value)
    assert found == pytest.approx(value, rel=5e-3)
    assert found == np.round(found, 2 - math.floor(math.log10(found)))
