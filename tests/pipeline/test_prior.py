"""Claims about the prior: what it is made of, what it says, the basins found on it, and how it may fail."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from bowl import proposed
from conditions_of_campaigns import MODES
from examples import examples, in_turn
from softclose.device.protocol import CannotSimulate
from softclose.evaluate import draw, respond
from softclose.evaluate.judging import judge
from softclose.evaluate.scoring import objective_settings
from softclose.metrics.objective import Judged, assess
from softclose.metrics.value import objective_value
from softclose.propose import asked_ahead, prior_basins, stretches
from softclose.propose import prior as prior_module
from softclose.propose.correction import (
    CONSTANT_SD,
    LEAST_SPREAD,
    RESIDUAL_SD,
    RHO_SD,
    ArsinhScale,
    Correction,
    Known,
    Looks,
    trend,
)
from softclose.propose.descents import Descent
from softclose.propose.deviation import COUNTS_AS, TOO_SURE, too_sure
from softclose.propose.plan import plan
from softclose.propose.prior import Prior, prior_config
from softclose.propose.prior_basins import find_basins
from softclose.propose.promises import PriorError, PriorValues
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem, seen_by
from softclose.propose.regions import RULES, region_of, rounds_of, shares
from softclose.propose.stretches import run_stretch
from softclose.propose.surrogate import surrogate_inputs
from softclose.settings import ConfigError, load_config
from softclose.waveform import Pulse, Waveform

SMALL = {
    "campaign": {"seed": 5, "budget": 30},
    "population": {"n_switches": 50},
    "waveform": {"space": "two-pulse-full"},
    "optimiser": {"n_regions": 3, "batch": 3, "rounds": 2},
    "explore": {"generation": 6, "n_scouts": 6},
    "prior": {
        "n_switches": 32,
        "n_exploring": 16,
        "budget": 120,
        "n_descents": 2,
        "polish": 20,
        "looks": 24,
    },
    "finish": {"n_switches": 100},
}


def config_of(**changed):
    return load_config({name: {**SMALL.get(name, {}), **changed.get(name, {})} for name in {*SMALL, *changed}})


TEMPERATURES = {
    "low_C": -40.0,
    "high_C": 85.0,
    "worst_of": 2,
    "celsius": [-40.0, 85.0],
    "stiffness": [1.08, 0.91],
}


class Bowl:
    """In place of the prior's model: a bowl around `middle` in the cube, 20 cm/s deep; counts what it was asked."""

    def __init__(self, config, middle=0.4, failing=False):
        self.space, self.middle, self.failing, self.asked = Problem(config).space, middle, failing, 0

    def values(self, waveforms, n_switches=None):
        self.asked += len(waveforms)
        if self.failing:
            return PriorValues(g_cm_s=np.full(len(waveforms), np.nan), failure="CannotSimulate: no licence")
        points = np.clip(self.space.coordinates_of_all(waveforms)[0], 0.0, 1.0)
        return PriorValues(g_cm_s=15.0 + 60.0 * ((points - self.middle) ** 2).mean(axis=1))


class Helped:
    """A prior whose basins were found on a bowl."""

    def __init__(self, config, **bowl):
        self.bowl = Bowl(config, **bowl)
        self.found = find_basins(config, self.bowl.values)

    def basins(self):
        return self.found

    def values(self, waveforms, n_switches=None):
        return self.bowl.values(waveforms, n_switches)


def campaign(config, help_, middle=0.45, failing=()):
    """A campaign against a bowl that is elsewhere than the prior's: its history and its proposals."""
    problem = Problem(config, help=help_)
    truth, proposer, history, proposals = Bowl(config, middle), Proposer(problem), [], []
    for wave in plan(problem):
        for i, p in enumerate(proposer.from_history(wave, history), start=wave.start):
            proposals.append(p)
            g = math.nan if i in failing else 2.0 + float(truth.values([p.waveform]).g_cm_s[0])
            history.append(proposed(i, wave.index, p, g, failed=math.isnan(g), beliefs=p.surrogate))
    return problem, history, proposals


# What g alone is.


@seed(7)
@settings(max_examples=examples(60), deadline=None)
@given(
    n=st.integers(1, 80),
    touching=st.floats(0.0, 1.0),
    failed=st.floats(0.0, 0.1),
    form=st.sampled_from(["penalty", "chance"]),
    risk=st.sampled_from(["quantile", "cvar"]),
    assured=st.booleans(),
    key=st.integers(0, 10_000),
)
def test_g_alone_is_that_of_the_assessment_bit_for_bit(n, touching, failed, form, risk, assured, key):
    rng = np.random.default_rng(key)
    contact, closed = rng.random(n) < touching, rng.random(n) < 0.8
    status = (rng.random(n) < failed).astype(np.int8)
    response = Judged(
        max_contact_speed=np.where(contact, 0.2 * rng.random(n), np.nan),
        closed=closed & contact,
        status=status,
        settling_us=np.where(closed & contact, 200.0 * rng.random(n), np.inf),
    )
    said = {
        "c1_cm_s": 25.0, "level": 0.9, "form": form, "risk": risk, "p_max": 0.05 if form == "chance" else None,
        "assured": assured, "closed_by_us": 150.0, "chance_penalty_cm_s": 500.0, "min_contact": 0.1,
        "undefined_v_u_cm_s": 60.0, "confidence": 0.95,
    }  # fmt: skip
    expected, (g, p_nc) = assess(response, **said), objective_value(response, **said)
    assert g == expected.g_cm_s or (math.isnan(g) and math.isnan(expected.g_cm_s))
    assert p_nc == expected.p_nc


# What the prior is.


def test_the_prior_of_a_plain_campaign_is_its_own_model_on_few_switches():
    config = config_of()
    prior = Prior.of(config)
    waveforms = Problem(config).space.waveforms(np.random.default_rng(3).random((4, 6)))
    found = prior.values(waveforms)
    assert len(prior.lot) == 32
    for n, values in ((32, found), (16, prior.values(waveforms, 16))):
        for waveform, g in zip(waveforms, values.g_cm_s, strict=True):
            response = respond(prior.config, prior.lot.rows(slice(n)), waveform)
            found = judge(prior.config, response)
            assert g == found.g_cm_s if found.p_nc <= 0.1 else g >= 120.0


def test_the_prior_weighs_what_the_campaign_weighs():
    config = config_of(objective={"weights": {"peak": 0.1}, "max_open": 1.0})
    prior, plain = Prior.of(config), Prior.of(config_of(objective={"max_open": 1.0}))
    waveforms = Problem(config).space.waveforms(np.random.default_rng(3).random((3, 6)))
    for waveform, g, without in zip(
        waveforms, prior.values(waveforms).g_cm_s, plain.values(waveforms).g_cm_s, strict=True
    ):
        found = judge(prior.config, respond(prior.config, prior.lot, waveform))
        assert g != without
        assert g == found.g_cm_s


@pytest.mark.parametrize(
    ("section", "value", "included"),
    [
        ("amplifier", {"bandwidth_kHz": 50.0}, "amplifier"),
        ("temperature", TEMPERATURES, "temperature"),
        ("trim", {"measured": "pull-in"}, "trim"),
    ],
)
def test_a_condition_is_the_prior_s_where_it_is_included(section, value, included):
    there = prior_config(config_of(**{section: value}))
    gone = prior_config(config_of(**{section: value}, prior={"includes": ["losses"]}))
    plain = prior_config(config_of())
    assert getattr(there, section) != getattr(plain, section)
    assert getattr(gone, section) == getattr(plain, section)


def test_losses_are_the_prior_s_where_they_are_included():
    lossy = {"quality_factor": 20.0, "film_viscosity_uPa_s": 0.2, "adhesion_uN": 20.0}
    assert prior_config(config_of(model=lossy)).model.build_losses() == config_of(model=lossy).model.build_losses()
    assert prior_config(config_of(model=lossy, prior={"includes": []})).model.build_losses().none


def test_a_prior_sees_other_switches_than_the_campaign():
    config = config_of(population={"n_switches": 32, "sampling": "sobol"})
    training = draw(config, 32, seed=config.campaign.seed, sampling="sobol")
    assert not np.isin(Prior.of(config).lot["D"], training["D"]).any()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"prior": {"model": "measured"}}, "prior.model is measured"),
        ({"prior": {"model": "reduced-order"}}, "the campaign's own model has no modes"),
        ({"optimiser": {"n_regions": 31}}, "optimiser.n_regions is 31, and campaign.budget leaves 30"),
        ({"prior": {"includes": ["mirror"]}}, "prior.includes"),
    ],
)
def test_a_prior_that_cannot_be_is_refused_in_one_line(changed, said):
    with pytest.raises(ConfigError, match=said) as error:
        config_of(**changed)
    assert len(str(error.value).splitlines()) == 1


def test_the_prior_s_campaign_is_descents_on_few_switches_and_nothing_else():
    own = [[[0.0, 4.0, 4.0, 150.0], [16.0, 4.0, math.inf, 90.0]]]
    config = config_of(
        campaign={"extensions": [3]},
        waveform={"initial": own},
        finish={"budget": 30, "n_basins": 5},
        explore={"budget": 40, "turns": 2},
        population={"n_switches": 80},
        prior={"control": 800},
    )
    cheap = prior_config(config)
    assert (cheap.campaign.budget, cheap.campaign.extensions, cheap.waveform.initial) == (0, (), ())
    assert (cheap.explore.budget, cheap.explore.n_descents, cheap.explore.turns) == (120, 2, 1)
    assert cheap.explore.rounds == config.prior.rounds
    assert (cheap.population.n_switches, cheap.population.sampling) == (16, "sobol")
    finish = cheap.finish
    assert (finish.budget, finish.n_switches, finish.n_basins, finish.n_polished) == (20, 32, 8, 2)
    assert (finish.method, finish.grows) == ("cmaes", False)
    assert not cheap.has_prior
    assert (cheap.prior.control, cheap.prior.model) == (0, "none")
    assert cheap.campaign.seed == config.campaign.seed
    assert cheap.objective == config.objective
    few = config_of(prior={"n_switches": 8, "n_exploring": 16, "polish": 3})
    assert (prior_config(few).population.n_switches, prior_config(few).finish.n_basins) == (8, 3)
    assert prior_config(config_of(prior={"polish": 0})).finish.n_basins == 1


def test_a_prior_of_one_mode_has_no_modes_and_one_of_all_has_the_campaign_s():
    for name in ("single-mode", "reduced-order"):
        config = config_of(
            model={"name": "reduced-order", "modes": MODES}, compute={"rtol": 1e-7}, prior={"model": name}
        )
        cheap = prior_config(config)
        assert cheap.model.name == name
        assert (cheap.model.modes, cheap.reduced_order_model) == (
            ("", {}) if name == "single-mode" else (config.model.modes, config.reduced_order_model)
        )
    assert config.reduced_order_model


def test_the_prior_designs_no_opening():
    config = config_of(opening={"release_us": 260.0})
    assert config.opening.is_designed
    assert not prior_config(config).opening.is_designed


def told_by(monkeypatch, config, *responses):
    """What the prior says of waveforms that are answered so."""
    answers = iter(responses)
    monkeypatch.setattr(prior_module, "respond", lambda *_, **__: next(answers))
    return Prior.of(config).values(Problem(config).space.waveforms(np.full((len(responses), 6), 0.5)))


def answered(n_open, n_failed=0, speed=0.2):
    """Ten switches, some of which stay open and some of which could not be integrated."""
    status = np.zeros(10, dtype=np.int8)
    status[:n_failed] = 1
    return Judged(
        max_contact_speed=np.where(np.arange(10) < n_open, np.nan, speed),
        closed=np.arange(10) >= n_open,
        status=status,
        settling_us=np.where(np.arange(10) < n_open, np.inf, 50.0),
    )


@pytest.mark.parametrize("weights", [{}, {"peak": 0.0}])
def test_a_lot_that_leaves_too_many_open_is_beyond_all_others_the_more_the_worse(monkeypatch, weights):
    """And bounded, so that a process can learn beside it."""
    config = config_of(objective={"c1_cm_s": 25.0, "undefined_v_u_cm_s": 60.0, "max_open": 0.2, "weights": weights})
    n_open = (0, 1, 2, 3, 6, 10)
    answers = [answered(n) for n in n_open]
    if weights:
        answers = [replace(a, asked=np.full((10, 1), 100.0)) for a in answers]
    found = told_by(monkeypatch, config, *answers)
    np.testing.assert_allclose(found.g_cm_s[:3], [20.0, 22.5, 25.0])
    np.testing.assert_allclose(found.g_cm_s[3:], 120.0 * (1.0 + np.array([0.3, 0.6, 1.0])))
    assert found.failure == ""
    fast = told_by(monkeypatch, config, replace(answers[3], max_contact_speed=np.full(10, 2.0)))
    np.testing.assert_allclose(fast.g_cm_s, (200.0 + 7.5) * 1.3, err_msg="what is worse already stays so")


def test_too_many_failed_switches_are_no_value_and_the_first_failure_is_told(monkeypatch):
    config = config_of()
    found = told_by(monkeypatch, config, answered(0), answered(0, n_failed=8), answered(0))
    assert np.isnan(found.g_cm_s).tolist() == [False, True, False]
    assert found.failure == "too many switches could not be integrated"

    def in_turn_raising(*_, **__):
        raise CannotSimulate(f"number {next(numbers)}")

    numbers = iter(range(5))
    monkeypatch.setattr(prior_module, "respond", in_turn_raising)
    waveforms = Problem(config).space.waveforms(np.full((3, 6), 0.5))
    assert Prior.of(config).values(waveforms).failure == "CannotSimulate: number 0"


def test_the_prior_respects_the_campaign_s_limit_of_the_voltage():
    config = config_of(waveform={"max_volts": 170.0})
    high = Waveform([Pulse(0.0, 4.0, math.inf, 165.0)])
    assert np.isfinite(Prior.of(config).values([high]).g_cm_s).all()
    beyond = Prior.of(config_of()).values([high])
    assert np.isnan(beyond.g_cm_s).all()
    assert "may not exceed 150 V" in beyond.failure


def test_other_engines_have_no_prior():
    assert not config_of(optimiser={"engine": "sobol", "n_regions": 3}).has_prior
    assert Problem(config_of(prior={"model": "none"})).basins is None


# Basins.


def test_basins_are_where_the_prior_is_best_and_promise_what_it_said():
    config = config_of(prior={"budget": 400})
    bowl = Bowl(config)
    found = find_basins(config, bowl.values)
    assert found.n_tried == bowl.asked == 420
    assert list(found.g_cm_s) == sorted(found.g_cm_s)
    assert found.g_cm_s[0] < 15.2
    np.testing.assert_array_equal(bowl.values(found.waveforms).g_cm_s, found.g_cm_s)
    np.testing.assert_allclose(np.linalg.det(found.shapes), 1.0)
    again = find_basins(config, Bowl(config).values)
    assert again.waveforms == found.waveforms
    assert again.shapes.tobytes() == found.shapes.tobytes()


def test_basins_are_judged_on_the_most_switches_that_any_waveform_was_asked_on():
    """On few of them the bowl looks deeper by 5 cm/s."""
    config = config_of()
    bowl, asked = Bowl(config), []

    def few_flatter(waveforms, n_switches=None):
        asked.extend((w, n_switches) for w in waveforms)
        return PriorValues(g_cm_s=bowl.values(waveforms).g_cm_s - (5.0 if n_switches < 32 else 0.0))

    found = find_basins(config, few_flatter)
    assert {n for _, n in asked} == {16, 32}
    assert len(found.waveforms) == len(found.g_cm_s) == len(found.shapes) <= 3
    np.testing.assert_array_equal(found.g_cm_s, bowl.values(found.waveforms).g_cm_s)
    assert all((w, 32) in asked for w in found.waveforms)
    assert found.n_tried == len(asked)
    assert found.failure == ""


def test_what_is_told_of_a_wave_has_its_place_in_the_campaign(monkeypatch):
    config, asked, judged = config_of(), [], []
    bowl, real = Bowl(config), prior_basins.distinct_basins

    def watched(problem, records, *rest):
        judged.extend(records)
        return real(problem, records, *rest)

    monkeypatch.setattr(prior_basins, "distinct_basins", watched)
    find_basins(config, lambda waveforms, _: asked.extend(waveforms) or bowl.values(waveforms))
    assert [o.index for o in judged] == list(range(120, 140))
    assert [o.waveform for o in judged] == asked[120:]
    wave = plan(Problem(prior_config(config)))[3]
    later = SimpleNamespace(waveform=asked[7], origin="descent")
    records = prior_basins._records(wave, 2, [later, later], PriorValues(g_cm_s=np.array([20.0, np.nan])))
    assert [o.index for o in records] == [wave.start + 2, wave.start + 3]
    assert [o.failed for o in records] == [False, True]
    assert {(o.wave, o.n_switches) for o in records} == {(wave.index, wave.n_switches)}


def test_the_shape_of_a_basin_is_that_of_the_descent_that_ended_nearest():
    space = Problem(config_of()).space
    runs = [SimpleNamespace(mean=np.full(6, x), shape=x * np.eye(6)) for x in (0.9, 0.3, 0.1)]
    problem = SimpleNamespace(space=space, descents=dict(enumerate(runs)))
    for x, nearest in ((0.95, 0.9), (0.32, 0.3), (0.25, 0.3), (0.0, 0.1)):
        shape = prior_basins._shape(problem, space.waveform(np.full(6, x)))
        np.testing.assert_array_equal(shape, nearest * np.eye(6))
    beyond = Waveform([Pulse(0.0, 4.0, 4.0, 100.0), Pulse(20.0, 4.0, math.inf, 170.0)])
    with pytest.raises(ValueError, match="is outside"):
        space.unit(beyond, clip=False)
    assert prior_basins._shape(problem, beyond).shape == (6, 6), "the edge of the ranges is nearest"
    none = SimpleNamespace(space=space, descents={})
    np.testing.assert_array_equal(prior_basins._shape(none, beyond), np.eye(6))


def test_a_prior_without_a_value_or_a_word_is_said_to_have_none():
    config = config_of()
    found = find_basins(config, lambda waveforms, _: PriorValues(g_cm_s=np.full(len(waveforms), np.nan)))
    assert found.failure == "no waveform has a value on the prior"
    assert found.waveforms == ()
    assert found.shapes.shape == (0, 6, 6)
    assert found.n_tried == plan(Problem(prior_config(config)))[0].size, "nobody goes on asking it"


def test_what_fails_here_and_there_is_no_basin_and_no_failure():
    config = config_of()
    bowl = Bowl(config)

    def now_and_then(waveforms, _):
        values = bowl.values(waveforms).g_cm_s
        values[::4] = np.nan
        return PriorValues(g_cm_s=values, failure="CannotSimulate: now and then")

    found = find_basins(config, now_and_then)
    assert np.isfinite(found.g_cm_s).all()
    assert found.g_cm_s[0] < 18.0
    assert found.failure == ""
    assert found.n_tried == 140


class Elsewhere:
    """A bowl that is asked by workers: what is begun is evaluated when it is waited for."""

    def __init__(self, config, n_elsewhere=1, **bowl):
        self.bowl, self.begun, self.waited, self.most, self.ahead = Bowl(config, **bowl), {}, 0, 0, 0
        self.has_waited, self.n_elsewhere = False, n_elsewhere
        self.stretches, self.problems = [], [Problem(prior_config(config)) for _ in range(n_elsewhere)]
        self.dealt = []

    def begin(self, waveforms, n_switches, *, beside=1):
        self.dealt.append((len(waveforms), beside))
        return self._begin((list(waveforms), n_switches))

    def begin_stretch(self, stretch):
        self.stretches.append(stretch)
        return self._begin(stretch)

    def _begin(self, question):
        self.ahead += self.has_waited and len(self.begun) > self.waited
        self.begun[len(self.begun)], self.has_waited = question, False
        self.most = max(self.most, len(self.begun) - self.waited)
        return len(self.begun) - 1

    def _waited(self, number):
        question, self.begun[number], self.has_waited = self.begun[number], None, True
        self.waited += 1
        return question

    def wait(self, number):
        return self.bowl.values(*self._waited(number))

    def wait_stretch(self, number):
        # A worker that has run another stretch of the descent, or one that has not.
        return run_stretch(self.problems[number % self.n_elsewhere], self.bowl.values, self._waited(number))


BUDGETS = [
    ({"budget": 400}, 2),
    ({"budget": 397, "n_descents": 5, "rounds": 3}, 5),
    ({"budget": 300, "n_descents": 1}, 2),  # of the polish
    ({"budget": 40, "n_descents": 3}, 3),
    ({"budget": 400, "n_descents": 4, "polish": 200}, 4),
]


@pytest.mark.parametrize(("prior", "most"), in_turn((pytest.param(*budget) for budget in BUDGETS), 2))
def test_who_need_not_be_waited_for_is_asked_ahead_and_the_basins_are_the_same(prior, most):
    config = config_of(prior=prior)
    bowl, workers = Bowl(config), Elsewhere(config)
    found, same = find_basins(config, bowl.values), find_basins(config, workers)
    assert_same(found, same)
    assert workers.bowl.asked == bowl.asked == found.n_tried, "nothing is evaluated twice"
    assert workers.waited == len(workers.begun), "nothing is asked in vain"
    assert workers.most == most
    assert (workers.ahead > 0) == (prior.get("n_descents", 2) > 1 and prior["budget"] > 40)
    assert not workers.stretches


@pytest.mark.parametrize("n_elsewhere", in_turn([2, 3, 8], 3))
@pytest.mark.parametrize(
    ("prior", "most", "worth"),
    in_turn((pytest.param(*budget, worth) for budget in BUDGETS for worth in (stretches.WORTH, 24 * 100)), 3),
)
def test_workers_run_descents_by_themselves_and_the_basins_are_the_same(prior, most, n_elsewhere, worth, monkeypatch):
    monkeypatch.setattr(stretches, "WORTH", worth)
    monkeypatch.setattr(asked_ahead, "WORTH", 10 * worth)
    config = config_of(prior=prior)
    bowl, workers = Bowl(config), Elsewhere(config, n_elsewhere)
    found, same = find_basins(config, bowl.values), find_basins(config, workers)
    assert_same(found, same)
    assert workers.bowl.asked == bowl.asked == found.n_tried, "nothing is evaluated twice"
    assert workers.waited == len(workers.begun), "nothing is asked in vain"
    assert max((s.n_generations for s in workers.stretches), default=0) > 2 or prior["budget"] == 40
    assert any(s.descent.beginning.goes_on_at for s in workers.stretches) == ("polish" in prior)


@pytest.mark.parametrize(
    ("worth", "lengths"),
    [
        # Six points on 16 switches: 33 generations each, then 66 of the better one; on 32 switches 18, then 36.
        pytest.param(10**6, [33, 33, 66, 18, 18, 36], marks=pytest.mark.long),
        (960, [*[11] * 6, 10, 10, 10, 9, 9, 9, 9, *[5] * 4, *[4] * 4, 6, *[5] * 6]),
    ],
)
def test_every_whole_generation_is_of_a_stretch(worth, lengths, monkeypatch):
    monkeypatch.setattr(stretches, "WORTH", worth)
    monkeypatch.setattr(stretches, "UNHURRIED", 1)
    workers = Elsewhere(config := config_of(prior={"budget": 804, "polish": 440}), 2)
    assert_same(find_basins(config, Bowl(config).values), find_basins(config, workers))
    assert [s.n_generations for s in workers.stretches] == lengths
    assert workers.dealt == [(12, 1), (8, 1)], "scouts, and the basins again"


@pytest.mark.parametrize(
    ("trajectories", "left", "is_dealt", "generations"),
    [(1_000, 40, True, 40), (10_000, 40, True, 4), (10_000, 40, False, 14), (2**20, 5, True, 1), (1, 1, False, 1)],
)
def test_a_stretch_is_as_long_as_it_is_worth_a_message(trajectories, left, is_dealt, generations):
    assert stretches.length(trajectories, left, is_dealt=is_dealt) == generations


def test_a_generation_that_is_worth_dealing_out_is_not_left_to_one_worker(monkeypatch):
    config = config_of(prior={"budget": 400})
    monkeypatch.setattr(asked_ahead, "WORTH", 1)
    workers = Elsewhere(config, 2)
    find_basins(config, workers)
    assert not workers.stretches
    assert (6, 2) in workers.dealt
    assert (6, 1) in workers.dealt


def assert_same(found, same):
    assert same.waveforms == found.waveforms
    assert same.g_cm_s.tobytes() == found.g_cm_s.tobytes()
    assert same.shapes.tobytes() == found.shapes.tobytes()


@pytest.mark.parametrize("n_elsewhere", in_turn([1, 2], 2, 1))
def test_a_descent_that_fails_ahead_fails_in_its_wave_as_it_would(monkeypatch, n_elsewhere):
    config, tell = config_of(prior={"budget": 400, "n_descents": 3}), Descent.tell

    def failing(self, g):
        if len(self.told) == 4 and self.points()[0, 0] > 0.45:
            raise np.linalg.LinAlgError("no factor")
        tell(self, g)

    monkeypatch.setattr(Descent, "tell", failing)
    workers = Elsewhere(config, n_elsewhere)
    assert_same(find_basins(config, Bowl(config).values), find_basins(config, workers))
    assert bool(workers.stretches) == (n_elsewhere > 1)


def test_a_worker_whose_descent_goes_another_way_changes_nothing():
    class Elsewhere2(Elsewhere):
        """Whose workers tell a descent something else from its third generation on."""

        def wait_stretch(self, number):
            stretch = self._waited(number)
            other = Problem(prior_config(config))
            run = run_stretch(other, self.bowl.values, stretch)
            if len(run) < 3:
                return run
            return [*run[:2], *(replace(generation, key=generation.key[::-1]) for generation in run[2:])]

    config = config_of(prior={"budget": 400, "n_descents": 2})
    workers = Elsewhere2(config, 2)
    assert_same(find_basins(config, Bowl(config).values), find_basins(config, workers))
    assert workers.stretches


def test_why_a_waveform_has_no_value_is_told_by_workers_too():
    config = config_of()
    found = find_basins(config, Elsewhere(config, failing=True))
    assert found.failure == "CannotSimulate: no licence"


def test_a_model_s_own_word_is_no_value_and_a_fault_of_the_machine_is_no_word(monkeypatch):
    prior = Prior.of(config_of())
    waveforms = Problem(config_of()).space.waveforms(np.full((2, 6), 0.5))

    def raising(error):
        def fail(*_, **__):
            raise error

        monkeypatch.setattr(prior_module, "respond", fail)

    raising(CannotSimulate("no convergence"))
    found = prior.values(waveforms)
    assert np.isnan(found.g_cm_s).all()
    assert found.failure == "CannotSimulate: no convergence"
    raising(RuntimeError("license server not reached"))
    with pytest.raises(PriorError, match="license server not reached"):
        prior.values(waveforms)


def test_a_prior_that_fails_by_its_own_word_is_on_record_and_the_campaign_goes_on():
    config = config_of(optimiser={"n_initial": 8})
    failing = Helped(config, failing=True)
    assert failing.found.failure == "CannotSimulate: no licence"
    assert failing.bowl.asked < 100  # nobody goes on asking it
    _, history, proposals = campaign(config, failing)
    assert {p.origin for p in proposals} == {"sobol", "trust-region"}
    assert all(o.usable for o in history)
    assert proposals[0].note == "no prior: CannotSimulate: no licence"


def test_a_fault_of_the_prior_s_machine_is_no_proposal():
    config = config_of()
    helped = Helped(config)
    problem = Problem(config, help=helped)

    def fail(*_):
        raise PriorError("no worker is left")

    helped.values = fail
    first = plan(problem)[0]
    proposer = Proposer(problem)
    proposals = proposer.from_history(first, [])
    records = [
        Observation(
            index=i, wave=0, waveform=p.waveform, origin=p.origin, n_switches=50, g_cm_s=20.0 + i, rank_cm_s=20.0 + i,
            g_se_cm_s=0.1,
            v_u_cm_s=20.0, mean_cm_s=10.0, p_nc=0.0, p_contact=1.0, failed=False, beliefs=p.surrogate,
        )
        for i, p in enumerate(proposals)
    ]  # fmt: skip
    with pytest.raises(PriorError, match="no worker is left"):
        proposer.from_history(plan(problem)[1], records)


# Proposals.


def test_the_process_learns_what_the_prior_does_not_know():
    """The campaign's bowl lies elsewhere, and 2 cm/s higher."""
    config = config_of(campaign={"seed": 5, "budget": 45})
    _, history, proposals = campaign(config, Helped(config))
    first = min(o.g_cm_s for o in history[:3])
    assert min(o.g_cm_s for o in history) < 17.0 + 0.3 * (first - 17.0)
    assert [p.origin for p in proposals] == ["prior-basin"] * 3 + ["trust-region"] * 42


def test_every_proposal_says_what_the_prior_promised_and_what_the_process_expects():
    config = config_of()
    helped = Helped(config)
    _, history, proposals = campaign(config, helped)
    for p in proposals:
        assert p.surrogate["prior_g_cm_s"] == helped.values([p.waveform]).g_cm_s[0]
    led = [(p.surrogate, o) for p, o in zip(proposals, history, strict=True) if p.origin == "trust-region"]
    errors = np.array([abs(o.g_cm_s - s["predicted_g_cm_s"]) / s["predicted_sd_cm_s"] for s, o in led])
    assert (errors < 3.0).mean() > 0.9
    assert all(s["looks"] == 24.0 for s, _ in led)


def test_proposals_are_a_function_of_the_records_alone():
    config = config_of()
    helped = Helped(config)
    problem, history, proposals = campaign(config, helped)
    for wave in plan(problem)[::3]:
        fresh = Proposer(Problem(config, help=helped)).from_history(wave, history)
        assert [p.waveform for p in fresh] == [p.waveform for p in proposals[wave.start : wave.stop]]
        assert [p.surrogate for p in fresh] == [p.surrogate for p in proposals[wave.start : wave.stop]]


def test_what_is_in_flight_counts_as_evaluated_by_the_process():
    """Where waveforms are in flight the process is sure of what it expects there, and looks elsewhere."""
    config = config_of(campaign={"seed": 5, "budget": 30, "lag": 3})
    helped = Helped(config)
    problem, history, proposals = campaign(config, helped)
    wave = plan(problem)[-1]
    seen, own = seen_by(wave, history), [p.waveform for p in proposals[wave.start : wave.stop]]
    alone = Proposer(problem).propose(wave, seen, [])
    beside = Proposer(problem).propose(wave, seen, [p.waveform for p in alone])
    assert len(seen) < wave.start
    assert own != [p.waveform for p in alone], "two waves are in flight"
    first, second = alone[0].surrogate["predicted_sd_cm_s"], beside[0].surrogate["predicted_sd_cm_s"]
    assert second < 0.95 * first
    points = problem.space.coordinates_of_all([p.waveform for p in (*alone, *beside)])[0]
    apart = ((points[:, None] - points[None]) ** 2).sum(axis=2)[np.triu_indices(len(points), 1)]
    assert apart.min() > 1e-8


def test_failed_candidates_and_waveforms_of_the_user_s_own_do_not_stop_the_process():
    own = [[[0.0, 4.0, 4.0, 150.0], [16.0, 4.0, math.inf, 90.0]]]
    config = config_of(waveform={"space": "two-pulse-full", "initial": own})
    _, history, proposals = campaign(config, Helped(config), failing={2, 5, 6})
    assert [p.origin for p in proposals][:5] == ["initial", *["prior-basin"] * 3, "trust-region"]
    assert "fallback" not in {p.origin for p in proposals}
    assert sum(o.usable for o in history) == 27


def test_rounds_share_the_budget_and_drop_the_worse_half():
    config = config_of(campaign={"seed": 5, "budget": 64}, optimiser={"n_regions": 4, "rounds": 3})
    problem = Problem(config)
    records = [(0, 20.0, 0), (1, 18.0, 1), (2, 19.0, 2), (3, 25.0, 3)]

    def dealt(start, size, more=(), in_flight=()):
        numbers, g, indices = zip(*records, *more, strict=True)
        known = {"numbers": numbers, "g": np.array(g), "indices": indices}
        found = shares(rounds_of(problem), start=start, size=size, **known, in_flight=in_flight)
        return {who: n for who, n in found.items() if n}

    assert dealt(4, 4) == {0: 1, 1: 1, 2: 1, 3: 1}
    assert dealt(4, 2) == {1: 1, 2: 1}
    assert dealt(4, 2, in_flight=[1]) == {0: 1, 2: 1}
    assert dealt(24, 4) == {1: 2, 2: 2}
    assert dealt(44, 4) == {1: 4}
    # Region 2 has two candidates, region 1, the better one, three with those in flight.
    assert dealt(6, 1, [(2, 30.0, 4)], in_flight=[1, 1, 0, 0, 0, 3, 3, 3]) == {2: 1}
    # What a region finds in a round counts at the end of that round.
    assert dealt(44, 4, [(2, 17.0, 30)]) == {2: 4}
    assert dealt(44, 4, [(2, 17.0, 50)]) == {1: 4}


def test_there_are_no_rounds_after_the_one_of_a_single_region():
    config = config_of(campaign={"seed": 5, "budget": 62}, optimiser={"n_regions": 2, "rounds": 5})
    known = {"numbers": [0, 1], "g": np.array([20.0, 18.0]), "indices": [0, 1]}
    dealt = [dict(shares(rounds_of(Problem(config)), start=start, size=2, **known)) for start in (31, 32)]
    assert dealt == [{0: 1, 1: 1}, {1: 2}]


def test_a_region_widens_where_it_finds_better_and_shrinks_where_it_does_not():
    """By its own records alone; candidates of one wave succeed together."""
    found = region_of(0, numbers=[0, 1, 0, 1, 0], g=np.array([20.0, 3.0, 19.0, 2.0, 18.0]), waves=[0, 0, 1, 1, 2])
    assert (found.number, found.incumbent, found.length) == (0, 4, 2.0 * RULES.initial)
    together = region_of(0, numbers=[0] * 3, g=np.array([20.0, 19.0, 18.0]), waves=[0, 0, 0])
    assert (together.incumbent, together.length) == (2, RULES.initial)
    worse = region_of(7, numbers=[7] * 7, g=np.array([20.0, *[21.0] * 5, 20.0]), waves=[*range(7)])
    assert (worse.number, worse.incumbent, worse.length) == (7, 0, 0.5 * RULES.initial)
    patient = region_of(7, numbers=[7] * 6, g=np.array([20.0, *[21.0] * 5]), waves=[*range(6)])
    assert patient.length == RULES.initial
    lucky = region_of(0, numbers=[0] * 40, g=np.arange(40.0, 0.0, -1.0), waves=[*range(40)])
    assert lucky.length == RULES.largest < 0.5, "a search does not leave the cube"


# The scale and the deviation.


@seed(11)
@settings(max_examples=examples(25), deadline=None)
@given(mean=st.floats(-2.0, 3.0), sd=st.floats(0.01, 0.8))
def test_mean_and_deviation_of_g_are_those_of_a_sample(mean, sd):
    scale = ArsinhScale(best_cm_s=15.0)
    z = mean + sd * np.random.default_rng(1).standard_normal(200_000)
    g = 15.0 + scale.width_cm_s * np.sinh(z)
    expected, deviation = scale.g(np.array([mean]), np.array([sd]))
    assert expected[0] == pytest.approx(g.mean(), abs=0.03 * g.std() + 1e-3)
    assert deviation[0] == pytest.approx(g.std(), rel=0.05)
    np.testing.assert_allclose(scale.z(g), z, atol=1e-9)


def test_the_trend_is_held_at_the_prior_and_follows_many_candidates():
    z = np.linspace(-1.0, 1.0, 60)
    assert trend(np.array([0.3]), np.array([0.0]))[0] == pytest.approx(1.0, abs=0.01)
    rho, constant = trend(0.6 * z + 0.2, z)
    assert (rho, constant) == (pytest.approx(0.6, abs=0.05), pytest.approx(0.2, abs=0.02))


def test_the_trend_is_the_likeliest_where_bad_candidates_count_little():
    """The oracle minimises the sum of squares in its own words."""
    rng = np.random.default_rng(3)
    prior = rng.uniform(-1.0, 3.0, 12)
    z = 0.7 * prior + 0.3 + 0.2 * rng.standard_normal(12)

    def misfit(both):
        rho, constant = both
        away = (z - rho * prior - constant) / RESIDUAL_SD
        return (
            (away**2 / (1.0 + np.maximum(z, 0.0) ** 2)).sum()
            + ((rho - 1.0) / RHO_SD) ** 2
            + (constant / CONSTANT_SD) ** 2
        )

    assert trend(z, prior) == pytest.approx(tuple(minimize(misfit, (1.0, 0.0)).x), abs=1e-4)


@pytest.mark.parametrize(("more", "noise"), [(0.0, 0.0), (2.0, 0.0), (2.0, 3.0)])
def test_a_process_near_its_incumbent_knows_what_the_prior_leaves_and_what_is_in_flight(more, noise):
    """The campaign finds 0 or 2 cm/s more than its prior promised, and some noise; z is 0 at the incumbent."""
    problem, rng = Problem(config_of()), np.random.default_rng(7)
    points = rng.uniform(0.2, 0.8, (24, problem.space.dim))
    prior = rng.uniform(15.0, 20.0, 24)
    g = prior + more + noise * rng.standard_normal(24)
    known = Known(points=points, inputs=surrogate_inputs(problem, points), g_cm_s=g, prior_g_cm_s=prior)
    incumbent = int(np.argmin(g))
    found = Correction(problem, known, incumbent)
    assert found.scale.z(g)[incumbent] == 0.0
    left = found.scale.z(g) - found.trend(prior)
    assert found.spread == pytest.approx(max(left.std(), LEAST_SPREAD))
    assert (found.spread > LEAST_SPREAD) == (more > 0.0)
    assert abs(left).max() < 0.3 or noise
    somewhere = found.screen(np.full((1, problem.space.dim), 0.9), np.array([16.0]))
    before = somewhere.z()[1][0]
    found.believe(somewhere.points)
    assert found.screen(somewhere.points, np.array([16.0])).z()[1][0] < 0.9 * before


def test_what_is_near_comes_in_the_order_of_its_distance_itself_first():
    points = np.array([[0.9, 0.1], [0.5, 0.5], [0.5, 0.6], [0.1, 0.5], [0.5, 0.4]])
    g = np.arange(5.0)
    near = Known(points=points, inputs=10.0 * points, g_cm_s=g, prior_g_cm_s=-g).nearest(1, 4)
    assert near.g_cm_s.tolist() == [1.0, 2.0, 4.0, 3.0]
    np.testing.assert_array_equal(near.points, points[[1, 2, 4, 3]])
    np.testing.assert_array_equal(near.inputs, 10.0 * near.points)
    np.testing.assert_array_equal(near.prior_g_cm_s, -near.g_cm_s)


def test_nothing_overflows_however_far_from_the_best_a_point_is():
    scale = ArsinhScale(best_cm_s=15.0)
    for mean in (-1e3, 1e3):
        expected, deviation = scale.g(np.array([mean]), np.array([50.0]))
        assert np.isfinite([expected[0], deviation[0]]).all()
        assert np.sign(expected[0] - 15.0) == np.sign(mean)


def test_the_expected_improvement_is_what_a_sample_improves_on_average():
    """On the incumbent, which is 0 on the scale; a point without a prior is never taken."""
    mean, sd = np.array([-0.5, 0.2, 1.0, np.nan]), np.array([0.3, 0.5, 0.4, 0.4])
    told = SimpleNamespace(predict=lambda _: (2.0 * mean, 2.0 * sd))
    around = SimpleNamespace(trend=lambda g: g, spread=0.5)
    looks = Looks(correction=around, screened=told, prior_g_cm_s=np.array([0.0, 0.1, -0.2, 0.0]))
    sample = looks.prior_g_cm_s + mean + sd * np.random.default_rng(5).standard_normal((400_000, 4))
    found = looks.improvement()
    np.testing.assert_allclose(found[:3], np.maximum(-sample, 0.0).mean(axis=0)[:3], rtol=0.01)
    assert found[3] == -np.inf
    np.testing.assert_allclose(looks.bound(2.0)[:3], (looks.prior_g_cm_s + mean - 2.0 * sd)[:3])
    assert looks.bound(2.0)[3] == np.inf


def test_the_deviation_grows_with_the_errors_that_were_seen():
    def told(error, n):
        said = {"predicted_g_cm_s": 15.0, "predicted_sd_cm_s": 0.2, "deviation_factor": 2.0}
        o = Observation(
            index=0, wave=0, waveform=None, origin="trust-region", n_switches=1, g_cm_s=15.0 + error,
            rank_cm_s=15.0 + error, g_se_cm_s=0.1,
            v_u_cm_s=15.0, mean_cm_s=15.0, p_nc=0.0, p_contact=1.0, failed=False, beliefs=said,
        )  # fmt: skip
        return too_sure([o] * n)

    assert told(0.0, 0) == TOO_SURE
    # The process itself said 0.1: 0.1 off is one of its deviations, 0.3 three.
    assert told(0.3, 40) == pytest.approx(math.sqrt((COUNTS_AS * TOO_SURE**2 + 40 * 9.0) / (COUNTS_AS + 40)))
    assert told(0.1, 40) < TOO_SURE < told(0.3, 4) < told(0.3, 40)
    assert told(50.0, 40) == pytest.approx(math.sqrt((COUNTS_AS * TOO_SURE**2 + 40 * 16.0) / (COUNTS_AS + 40)))


def test_settings_of_the_objective_are_all_handed_on():
    config = config_of()
    names = set(objective_settings(config)) - set(prior_module.NOT_OF_G)
    import inspect

    assert names == set(inspect.signature(objective_value).parameters) - {"response"}
    assert replace(config, campaign=replace(config.campaign, seed=6)).has_prior
