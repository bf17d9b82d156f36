"""Claims about quantities that a campaign asks for: each may be weighed, limited, or told, and counts as it says."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from conditions_of_campaigns import CONDITIONS, DRIVE, TABLES, merged
from softclose.evaluate import draw, evaluate, judge, respond
from softclose.evaluate.asked import asked, limited, told, value_of
from softclose.evaluate.judging import judge_with
from softclose.evaluate.pieces import light
from softclose.evaluate.quantities import QUANTITIES, Closing, Quantity
from softclose.evaluate.touching import contacts
from softclose.metrics import replicates
from softclose.metrics.control import Control
from softclose.metrics.intervals import normal_quantile
from softclose.metrics.objective import Judged
from softclose.plugins import QuantityError
from softclose.settings import CampaignConfig, ConfigError, load_config
from softclose.waveform import Waveform, WaveformError

N = 160
OF_SWITCHES = [name for name, q in QUANTITIES.items() if q.per != "lot"]


def configured(**objective: Any) -> CampaignConfig:
    return load_config(
        {
            "population": {"n_switches": N, "sampling": "monte-carlo"},
            "store": {"max_impacts": 64},
            "objective": objective,
        }
    )


PLAIN = configured()
LOT = draw(PLAIN, N, seed=3)


def by_hand(q: Quantity, config: CampaignConfig) -> Any:
    """Its value from a response that nothing was asked of."""
    response = respond(PLAIN, LOT, DRIVE, max_impacts=64)
    return q.of(Closing.of(config, LOT, DRIVE, response, fresh=True))


@pytest.mark.parametrize("name", OF_SWITCHES)
def test_a_response_tells_what_is_asked_of_each_switch(name: str) -> None:
    config = configured(lines=[name])
    response = respond(config, LOT, DRIVE)
    assert response.asked is not None
    assert response.asked.shape == (N, 1)
    plain = respond(PLAIN, LOT, DRIVE, max_impacts=64)
    expected = QUANTITIES[name].values(Closing.of(PLAIN, LOT, DRIVE, plain))
    assert_array_equal(response.asked[:, 0], np.broadcast_to(expected, N))
    assert_array_equal(response.max_contact_speed, plain.max_contact_speed)
    assert told(config, response, judge(config, response), fresh=True)[name] == by_hand(QUANTITIES[name], PLAIN)


def test_nothing_is_asked_where_nothing_is_said() -> None:
    assert asked(PLAIN) == ()
    assert respond(PLAIN, LOT, DRIVE).asked is None
    assert told(PLAIN, respond(PLAIN, LOT, DRIVE), judge(PLAIN, respond(PLAIN, LOT, DRIVE))) == {}


@pytest.mark.parametrize("name", [n for n, q in QUANTITIES.items() if "objective" in q.uses])
def test_g_weighs_a_quantity_by_its_value(name: str) -> None:
    weight = -0.3 if QUANTITIES[name].better == "high" else 0.3
    config = configured(weights={name: weight})
    response = respond(config, LOT, DRIVE)
    found, plain = judge(config, response), judge(PLAIN, response)
    value = by_hand(QUANTITIES[name], PLAIN)
    assert_allclose(found.g_cm_s, plain.g_cm_s + weight * value.estimate, rtol=1e-12)
    assert found.rank_cm_s == found.g_cm_s or found.p_nc > found.max_open
    low, high = found.g_interval
    assert low < found.g_cm_s < high
    # Bonferroni: the parts at twice the certainty, so the whole is wider than the plain one about its own value.
    assert high - low >= plain.g_interval[1] - plain.g_interval[0]
    sure = 1.0 - (1.0 - plain.confidence) / 2.0
    strict = judge(replace(config, objective=replace(config.objective, confidence=sure)), response)
    values = told(config, response, strict, fresh=True)
    width = np.diff(values[name].interval)[0] if name in values else math.inf
    if math.isfinite(width):
        error = 0.5 * 0.3 * width / normal_quantile(sure)
        assert_allclose(found.g_se_cm_s, plain.g_se_cm_s + error, rtol=1e-12)
    assert (found.v_u_cm_s, found.p_nc) == (plain.v_u_cm_s, plain.p_nc)


@pytest.mark.parametrize("name", [n for n, q in QUANTITIES.items() if "limit" in q.uses])
def test_a_limit_is_kept_or_passed_by_its_own_measure(name: str) -> None:
    q = QUANTITIES[name]
    value = by_hand(q, PLAIN)
    if math.isinf(value.estimate):  # too many stay open: beyond any limit
        config = configured(quantity_limits={name: 200.0})
        found = judge(config, respond(config, LOT, DRIVE))
        assert (found.g_cm_s, found.feasible) == (math.inf, False)
        return
    width = value.interval[1] - value.interval[0]
    bounded = math.isfinite(width)  # an interval that is open above keeps no limit
    room = 3.0 * (width if bounded else 1.0) + 0.01 * abs(value.estimate) + 1e-3
    sign = 1.0 if q.better == "low" else -1.0
    for beyond, feasible in ((room, True), (-room, False)):
        limit = value.estimate + sign * beyond
        config = configured(quantity_limits={name: limit}, limit_penalty_cm_s=50.0)
        response = respond(config, LOT, DRIVE)
        found, plain = judge(config, response), judge(PLAIN, response)
        passed = max(0.0, -beyond) / abs(limit)
        assert_allclose(found.g_cm_s, plain.g_cm_s + 50.0 * passed, rtol=1e-9)
        assert found.feasible == (feasible and bounded), value


def test_an_interval_about_its_limit_is_not_feasible() -> None:
    value = by_hand(QUANTITIES["hold_margin"], PLAIN)
    assert value.interval[0] < value.estimate < value.interval[1]
    config = configured(quantity_limits={"hold_margin": value.estimate - 1e-9})
    found = judge(config, respond(config, LOT, DRIVE))
    assert found.g_cm_s == judge(PLAIN, respond(PLAIN, LOT, DRIVE)).g_cm_s  # the estimate keeps it
    assert not found.feasible  # its interval does not


def test_several_add_up_whatever_their_order() -> None:
    weights = {"peak": 0.1, "impact_energy": 2.0}
    config, other = configured(weights=weights, lines=["slope"]), configured(weights=dict(reversed(weights.items())))
    response = respond(config, LOT, DRIVE)
    assert [q.name for q in asked(config)] == ["impact_energy", "peak", "slope"]
    found = judge(config, response).g_cm_s
    assert found == judge(other, respond(other, LOT, DRIVE)).g_cm_s
    values = told(config, response, judge(PLAIN, response), fresh=True)
    plain = judge(PLAIN, response).g_cm_s
    assert_allclose(found, plain + sum(w * values[name].estimate for name, w in weights.items()), rtol=1e-12)


def test_figures_of_one_quasi_random_sample_have_no_interval_and_those_of_new_switches_have() -> None:
    """A campaign that trains on a Sobol sample and weighs a quantity: on its own switches, and on fresh ones."""
    config = load_config({"population": {"sampling": "sobol"}, "objective": {"weights": {"hold_margin": -0.1}}})
    response = respond(config, LOT, DRIVE)
    for found in (judge(config, response), evaluate(config, LOT, DRIVE)):
        assert not found.intervals_valid
        assert np.isnan(found.g_interval).all()
    for found in (judge(config, response, fresh=True), evaluate(config, LOT, DRIVE, fresh=True)):
        assert found.intervals_valid
        assert found.g_interval[0] < found.g_cm_s < found.g_interval[1]
    with pytest.raises(WaveformError):
        evaluate(config, LOT, DRIVE, max_volts=50.0)
    kept = replace(config, objective=replace(config.objective, weights={}, quantity_limits={"hold_margin": 1.0}))
    a = judge(kept, response)
    assert np.isnan(limited(kept, response, a)["hold_margin"].interval).all()
    assert np.isfinite(limited(kept, response, a, fresh=True)["hold_margin"].interval).all()


def test_a_control_variate_narrows_g_also_where_g_weighs_more() -> None:
    """A cheap model that is the costly one, on the same switches and on many more."""
    config = configured(weights={"hold_margin": -0.1})
    response = respond(config, LOT, DRIVE)
    control = Control(same=response, many=respond(PLAIN, draw(PLAIN, 3000, seed=4), DRIVE))
    found, alone = judge_with(config, response, control), judge(config, response)
    added = alone.g_cm_s - judge(PLAIN, response).g_cm_s
    assert_allclose(found.g_cm_s, judge_with(PLAIN, response, control).g_cm_s + added, rtol=1e-12)
    assert found.g_cm_s != alone.g_cm_s
    widths = [a.g_interval[1] - a.g_interval[0] for a in (found, alone)]
    assert widths[0] < 0.9 * widths[1]


def test_first_contacts_and_impacts_are_told_of_those_that_touch_by_whoever_tells_them() -> None:
    response, a = respond(PLAIN, LOT, DRIVE), judge(PLAIN, respond(PLAIN, LOT, DRIVE))
    found = contacts(PLAIN, response, a)
    touched = response.n_impacts > 0
    for name, values in (("contact_time", response.first_contact_us), ("impacts", response.n_impacts)):
        assert found[name].estimate == np.sort(values[touched])[math.ceil(a.level * touched.sum()) - 1]
        assert found[name].interval[0] <= found[name].estimate <= found[name].interval[1]
    even = load_config({"population": {"sampling": "sobol"}})
    assert np.isnan(contacts(even, response, a)["contact_time"].interval).all()
    assert contacts(even, response, a, fresh=True) == found
    for name in ("first_contact_us", "n_impacts"):
        assert contacts(PLAIN, replace(light(response), **{name: None}), a) == {}
    assert contacts(load_config({"model": {"name": "measured"}}), response, a) == {}


def test_what_is_undefined_is_no_merit() -> None:
    """No switch closes, so none has a force on its contact: g is undefined, and not as if the force were free."""
    config = configured(weights={"contact_force": -1.0})
    weak = Waveform.from_rows([[0.0, 10.0, math.inf, 10.0]])
    found = judge(config, respond(config, LOT, weak))
    assert math.isnan(found.g_cm_s)
    assert math.isnan(found.rank_cm_s)


@pytest.mark.parametrize("worst_of", [2, 3])
def test_at_its_worst_temperature_each_quantity_counts_at_its_own_worst(worst_of: int) -> None:
    names = ["hold_margin", "impact_energy"]
    data: dict[str, Any] = {
        "temperature": TABLES | {"worst_of": worst_of},
        "objective": {"lines": names},
        "store": {"max_impacts": 64},
    }
    config = load_config(data)
    lot = draw(config, 40, seed=1)
    from softclose.evaluate.respond import respond_each

    each = respond_each(config, lot, DRIVE)
    whole = respond(config, lot, DRIVE)
    assert len(each) == worst_of
    assert whole.asked is not None
    tables = np.stack([r.asked for r in each])
    assert_array_equal(whole.asked[:, 0], np.fmin.reduce(tables[..., 0]))
    assert_array_equal(whole.asked[:, 1], np.fmax.reduce(tables[..., 1]))
    assert np.ptp(tables[..., 0], axis=0).min() > 0.0


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_reaches_what_is_asked(condition: str) -> None:
    """Hold margins of each switch by itself: its own drive at the end, against its own holding voltage."""
    from softclose.evaluate.chain import cases_of, chain_of, drives_of
    from softclose.evaluate.quantities import held_voltages

    config = load_config(merged(condition) | {"store": {"max_impacts": 64}}, ["objective.lines=['hold_margin']"])
    lot = draw(config, 12, seed=2)
    response = respond(config, lot, DRIVE)
    assert response.asked is not None
    chain = chain_of(config)
    margins = []
    for i in range(len(lot)):
        one = lot.rows(slice(i, i + 1))
        drives = drives_of(chain, one, DRIVE)
        cases = [
            abs(held_voltages(chain, case, DRIVE, drives)) - chain.device.holding_voltage(case.switches)
            for case in cases_of(chain, one)
        ]
        margins.append(min(float(c[0]) for c in cases))
    assert_allclose(response.asked[:, 0], margins, rtol=1e-9, atol=1e-9)


def test_scramblings_give_the_interval_of_a_quantity() -> None:
    config = load_config(
        {"population": {"n_switches": 512, "sampling": "replicated"}, "objective": {"lines": ["hold_margin"]}}
    )
    lot = draw(config, 512, seed=1, sampling="replicated")
    response = respond(config, lot, DRIVE)
    a = judge(config, response)
    value = told(config, response, a)["hold_margin"]
    assert response.asked is not None
    column = response.asked[:, 0]
    parts = [-np.sort(-column[r::16])[math.ceil(0.9 * 32) - 1] for r in range(16)]
    expected = replicates.about(value.estimate, np.array(parts), a.confidence)
    assert_allclose(value.interval, expected, rtol=1e-12)
    sobol = load_config({"population": {"sampling": "sobol"}, "objective": {"lines": ["hold_margin"]}})
    assert all(math.isnan(end) for end in told(sobol, response, a)["hold_margin"].interval)


@pytest.mark.parametrize("n", [5, 64])
def test_scramblings_leave_a_drive_s_quantity_and_an_undefined_one_as_they_are(n: int) -> None:
    a = judge(PLAIN, respond(PLAIN, LOT, DRIVE))
    peak = value_of(QUANTITIES["peak"], np.full(n, 111.6), a, "replicated")
    assert (peak.estimate, peak.interval, peak.n) == (111.6, (111.6, 111.6), 0)
    force = value_of(QUANTITIES["contact_force"], np.full(n, math.nan), a, "replicated")
    assert math.isnan(force.estimate)
    assert np.isnan(force.interval).all()


def test_an_interval_of_g_without_an_end_is_none() -> None:
    """So many stay open that nothing bounds the time in which nine in ten close, though the estimate is known."""
    config = configured(weights={"closing": -0.1})
    response = respond(config, LOT, DRIVE)
    plain = judge(PLAIN, response)
    assert math.isinf(plain.closing_interval[1])
    found = judge(config, response)
    assert found.intervals_valid
    assert np.isnan(found.g_interval).all()


def test_a_limit_of_nothing_may_be_passed() -> None:
    """It has no size to measure by: whoever passes it stands behind all who keep it, and nothing fails."""
    config = configured(quantity_limits={"impacts": 0.0})
    found = judge(config, respond(config, LOT, DRIVE))
    assert found.g_cm_s > 1e9
    assert not found.feasible


def test_a_response_that_does_not_tell_it_is_refused() -> None:
    config = configured(weights={"impact_energy": 1.0})
    bare = respond(PLAIN, LOT, DRIVE)
    for response in (bare, replace(bare, asked=np.zeros((N, 3)))):
        with pytest.raises(QuantityError, match="does not tell impact_energy"):
            judge(config, response)


def test_missing_readings_do_not_count_in_a_quantity() -> None:
    from softclose.metrics.objective import MISSING, those_read

    status = np.zeros(4, dtype=np.int8)
    status[1] = MISSING
    read = those_read(
        Judged(
            max_contact_speed=np.ones(4), closed=np.ones(4, bool), status=status, asked=np.arange(4.0)[:, np.newaxis]
        )
    )
    assert read.asked[:, 0].tolist() == [0.0, 2.0, 3.0]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "data",
    [
        {"objective": {"weights": {"speed": 1.0}}},
        {"objective": {"lines": ["impact"]}},
        {"objective": {"quantity_limits": {"": 1.0}}},
        {"optimiser": {"objectives": ["v_u", "nothing"]}},
    ],
)
def test_a_quantity_that_there_is_not_is_refused_by_name(data: Any) -> None:
    with pytest.raises(ConfigError, match="is no quantity; there are v_u, p_nc"):
        load_config(data)


def test_a_use_that_a_quantity_has_not_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(QUANTITIES, "peak", replace(QUANTITIES["peak"], uses=frozenset({"line"})))
    assert asked(configured(lines=["peak"]))
    with pytest.raises(ConfigError, match="peak cannot be used as limit; it may be line"):
        configured(quantity_limits={"peak": 1.0})


def test_nobody_measures_what_a_bench_does_not_tell() -> None:
    with pytest.raises(ConfigError, match="nobody measures impact_energy"):
        load_config({"model": {"name": "measured"}, "objective": {"lines": ["impact_energy"]}})
