"""Claims about the control variate: what its weights do, when it pays, and that its intervals hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from softclose.metrics import replicates
from softclose.metrics.control import LEAST, Control, controlled, gain, pays
from softclose.metrics.intervals import student_quantile
from softclose.metrics.objective import MISSING, Assessment, Judged, assess
from softclose.settings import ConfigError, load_config

SETTINGS = {
    "form": "penalty",
    "c1_cm_s": 25.0,
    "chance_penalty_cm_s": 500.0,
    "p_max": None,
    "assured": False,
    "sampling": "monte-carlo",
}


def judged(v_cm_s: np.ndarray, closed: np.ndarray) -> Judged:
    return Judged(max_contact_speed=v_cm_s / 100.0, closed=closed, status=np.zeros(len(closed), dtype=np.int8))


def lot(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) speeds [cm/s] of which one in fifty never touches, and which switches are closed."""
    rng = np.random.default_rng(seed)
    v = np.where(rng.random(n) < 0.02, np.nan, np.maximum(15.0 + 3.0 * rng.standard_normal(n), 0.0))
    return v, (rng.random(n) > 0.06) & ~np.isnan(v)


def both(a: Judged, control: Control, **changed: object) -> tuple[Assessment, Assessment]:
    """An assessment without and with the control variate."""
    settings = {**SETTINGS, **changed}
    plain = assess(a, **settings)
    return plain, controlled(plain, a, control, **settings)


def test_a_cheap_model_that_is_the_costly_one_tells_what_the_many_tell() -> None:
    own, many = judged(*lot(1, 200)), judged(*lot(2, 20_000))
    plain, found = both(own, Control(same=own, many=many))
    there = assess(many, **SETTINGS)
    assert found.mean_cm_s == pytest.approx(there.mean_cm_s, abs=1e-9)
    assert found.p_nc == pytest.approx(there.p_nc, abs=1e-12)
    assert abs(plain.v_u_cm_s - there.v_u_cm_s) > 0.3  # what there was to gain
    between = sorted((found.v_u_cm_s, there.v_u_cm_s))
    speeds = 100.0 * own.max_contact_speed
    assert ((speeds > between[0]) & (speeds < between[1])).sum() == 0, "the next of 200 speeds"
    assert found.g_cm_s == found.v_u_cm_s + 25.0 * found.p_nc
    assert gain(plain, found) < 0.7
    low, high = found.mean_interval
    assert high - low < 0.15 * (plain.mean_interval[1] - plain.mean_interval[0])


def test_a_share_is_that_of_a_regression_on_the_cheap_figures() -> None:
    """The oracle: ordinary least squares of open on what the cheap model says, told at the means of the many."""
    v, closed = lot(3, 150)
    rng = np.random.default_rng(4)
    cheap, cheap_closed = 0.8 * v + rng.standard_normal(150), closed ^ (rng.random(150) < 0.03)
    many, many_closed = lot(5, 5000)
    many = 0.8 * many
    threshold = np.sort(many[~np.isnan(many)])[math.ceil(0.9 * (~np.isnan(many)).sum()) - 1]

    def columns(speed: np.ndarray, shut: np.ndarray) -> np.ndarray:
        touched = ~np.isnan(speed)
        return np.stack(
            [np.ones(len(speed)), touched, np.nan_to_num(speed), touched & (speed <= threshold), shut], axis=1
        ).astype(float)

    slopes = np.linalg.lstsq(columns(cheap, cheap_closed), 1.0 - closed, rcond=None)[0]
    _, found = both(
        judged(v, closed),
        Control(same=judged(cheap, cheap_closed), many=judged(many, many_closed)),
    )
    assert found.p_nc == pytest.approx(columns(many, many_closed).mean(axis=0) @ slopes, abs=1e-9)
    # Its error: as if each switch were left out, the models differing on two more than was seen, and that of the many.
    own = columns(cheap, cheap_closed)
    free = 1.0 - np.einsum("ij,ij->i", own @ np.linalg.inv(own.T @ own), own)
    left = (1.0 - closed - own @ slopes) / free
    of_many = slopes @ np.cov(columns(many, many_closed).T) @ slopes / 5000
    error = math.sqrt((left @ left + 2.0) / (150 * 145) + of_many)
    low, high = found.p_nc_intervals.wilson
    assert high - found.p_nc == pytest.approx(student_quantile(0.95, 145) * error, rel=1e-6)
    assert low == pytest.approx(max(2.0 * found.p_nc - high, 0.0))


def test_a_cheap_model_that_has_nothing_to_do_with_it_does_not_pay() -> None:
    gains = []
    for k in range(5):
        plain, found = both(
            judged(*lot(10 + k, 100)),
            Control(same=judged(*lot(50 + k, 100)), many=judged(*lot(7, 5000))),
        )
        gains.append(gain(plain, found))
    assert min(gains) > 0.95
    assert not pays(gains)
    assert pays([0.5, 0.95, 0.6, math.nan])
    assert not pays([math.nan, math.nan])


def test_few_switches_and_a_cheap_model_of_one_answer_change_nothing() -> None:
    many = judged(*lot(2, 5000))
    few = judged(*lot(1, LEAST - 1))
    plain, found = both(few, Control(same=few, many=many))
    assert found is plain
    assert math.isnan(gain(plain, found))
    own, still = judged(*lot(1, 200)), judged(np.full(200, 9.0), np.ones(200, dtype=bool))
    plain, found = both(own, Control(same=still, many=many))
    assert found is plain
    failed = replace(many, status=np.ones(5000, dtype=np.int8))
    plain, found = both(own, Control(same=own, many=failed))
    assert found is plain
    lost = replace(own, status=np.r_[np.full(3, MISSING, np.int8), own.status[3:]])
    plain, found = both(lost, Control(same=own, many=many))
    assert found is plain, "which switch is which is not known where some were not read"


def test_scramblings_that_agree_leave_no_error_but_what_may_be_unseen() -> None:
    """Switch i belongs to scrambling i mod 16: all sixteen alike have no spread among them, whatever is within."""
    v, closed = (column.repeat(replicates.REPLICATES) for column in lot(6, 20))
    rng = np.random.default_rng(3)
    cheap = np.maximum(v + 2.0 * rng.standard_normal(20).repeat(replicates.REPLICATES), 0.0)
    control = Control(same=judged(cheap, closed), many=judged(*lot(2, 20_000)))
    own = judged(v, closed)
    _, independent = both(own, control)
    _, sectioned = both(own, control, sampling="replicated")
    assert sectioned.mean_cm_s == independent.mean_cm_s
    width, by_sections = (a.mean_interval[1] - a.mean_interval[0] for a in (independent, sectioned))
    assert by_sections < 0.3 * width  # what is left is what 20,000 do not know
    assert sectioned.p_nc_intervals.wilson[1] > sectioned.p_nc


def test_the_chance_form_judges_its_limit_by_the_controlled_interval() -> None:
    own, many = judged(*lot(1, 200)), judged(*lot(2, 20_000))
    plain, found = both(own, Control(same=own, many=many), form="chance", p_max=0.05)
    assert found.limit is not None
    assert plain.limit is not None
    assert found.limit.upper == found.p_nc_intervals.clopper_pearson[1] < plain.limit.upper
    assert found.g_cm_s == pytest.approx(found.v_u_cm_s + 500.0 * (found.p_nc - 0.05))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ("prior.model=none", "no search of this campaign starts from a prior"),
        ("optimiser.engine=cmaes", "no search of this campaign starts from a prior"),
        ("population.sampling=sobol", "no interval"),
        ("population.n_switches=50", "use 80 or more"),
        ("population.n_switches=600", "use 4800 or more"),
        ("objective.risk=cvar", "use quantile"),
    ],
)
def test_a_control_variate_that_cannot_be_is_refused(changed: str, said: str) -> None:
    load_config("current-costly", ["prior.control=4096"])
    with pytest.raises(ConfigError, match=said):
        load_config("current-costly", ["prior.control=4096", changed])
