"""Claims about the trust region: what lets it grow and shrink, where it starts again, and the box that it opens."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from softclose.propose.origins import LOCAL, RESTART, SOBOL
from softclose.propose.trust_region import TrustRegion, TrustRegionRules, replay

RULES = TrustRegionRules(initial=0.8, smallest=0.15, largest=1.6, successes=2, failures=3, improvement_cm_s=0.5)
WIDE = dataclasses.replace(RULES, smallest=0.0, largest=100.0)


def after(*g: float, rules: TrustRegionRules = WIDE) -> TrustRegion:
    """The region after a design point of 30 cm/s and local candidates with these g."""
    return replay([30.0, *g], [SOBOL] + [LOCAL] * len(g), rules)


def test_the_trust_region_doubles_halves_and_starts_again() -> None:
    assert replay([30, 29, 28], [SOBOL, LOCAL, LOCAL], RULES).length == 1.6
    assert replay([30, 31, 31, math.nan], [SOBOL, LOCAL, LOCAL, LOCAL], RULES).length == 0.4
    again = replay([30.0] * 10, [SOBOL] + [LOCAL] * 9, RULES)
    assert (again.restarts, again.begin, again.incumbent, again.length) == (1, 10, None, 0.8)


@pytest.mark.parametrize(
    ("g", "length"),
    [
        ((29, 28, 27), 1.6),  # a third success begins a new run
        ((29, 28, 27, 26), 3.2),
        ((40, 40, 40, 40, 40), 0.4),  # and so does a fourth failure
        ((40,) * 6, 0.2),
        ((29, 40, 28), 0.8),  # a failure ends a run of successes
        ((40, 29, 28), 1.6),  # one failure is no debt
        ((40, 40, 29, 40, 40), 0.8),  # a success ends a run of failures
        ((math.nan, math.nan, math.nan), 0.4),  # a candidate that failed is no success
        ((29, 29.5, 29.5, 29.5), 0.4),  # improving on the first is not enough, the best counts
    ],
)
def test_only_unbroken_runs_change_the_length(g: tuple[float, ...], length: float) -> None:
    assert after(*g).length == length


def test_an_improvement_too_small_to_matter_is_a_failure_and_still_the_incumbent() -> None:
    region = after(29.75, 29.25, 28.75)  # each 0.5 below the last or less; more is asked for
    assert region.length == 0.4
    assert region.incumbent == 3
    assert after(29.25, 28.5).length == 1.6


def test_the_length_stays_between_its_limits() -> None:
    assert after(29, 28, 27, 26, 25, 24, rules=RULES).length == RULES.largest
    at_the_limit = dataclasses.replace(RULES, smallest=0.2)
    assert (after(*[40] * 6, rules=at_the_limit).length, after(*[40] * 6, rules=at_the_limit).restarts) == (0.2, 0)
    assert after(*[40] * 9, rules=at_the_limit).restarts == 1


def test_other_origins_move_the_incumbent_and_nothing_else() -> None:
    region = replay([30, 29, 28, 27, 40], [SOBOL, RESTART, SOBOL, RESTART, RESTART], WIDE)
    assert (region.length, region.incumbent, region.begin) == (0.8, 3, 0)
    # It also sets what a local candidate has to beat.
    assert replay([30, 20, 29, 28], [SOBOL, RESTART, LOCAL, LOCAL], WIDE).length == 0.8


def test_runs_do_not_outlive_a_restart() -> None:
    fresh = [40.0] * 9
    assert after(*fresh, 35, rules=RULES).length == 0.8
    assert after(*fresh, 35, 34, rules=RULES).length == 1.6  # worse than the old best, better than its own
    assert after(*fresh, 35, 34, rules=RULES).incumbent == 11
    assert after(*fresh, 40, 40, rules=RULES).length == 0.8


@pytest.mark.parametrize("seed", range(10))
def test_the_incumbent_is_the_best_record_of_this_restart_or_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rules = TrustRegionRules(
        initial=0.8,
        smallest=float(rng.choice([0.1, 0.3])),
        largest=float(rng.choice([0.8, 1.6, 3.2])),
        successes=int(rng.integers(1, 4)),
        failures=int(rng.integers(1, 4)),
        fresh_every=int(rng.integers(1, 4)),
        fresh_before=None if rng.random() < 0.5 else int(rng.integers(60)),
        improvement_cm_s=float(rng.choice([0.0, 0.5])),
    )
    g = np.where(rng.random(80) < 0.1, np.nan, rng.integers(20, 120, 80) / 2.0).tolist()
    origins = rng.choice([SOBOL, RESTART, LOCAL, LOCAL, LOCAL], 80).tolist()
    for n in range(1, 81):
        region = replay(g[:n], origins[:n], rules)
        around_the_best = region.incumbent is not None and region.incumbent < region.begin
        begin = 0 if around_the_best else region.begin
        seen = [(v, i) for i, v in enumerate(g[:n]) if i >= begin and math.isfinite(v)]
        assert region.incumbent == (min(seen)[1] if seen else None)
        assert rules.smallest <= region.length <= rules.largest
        assert math.log2(region.length / rules.initial).is_integer()
    assert region.restarts > 0


def test_the_box_is_as_wide_as_the_region_along_an_average_axis() -> None:
    region = TrustRegion(length=0.4, incumbent=0, begin=0, restarts=0)
    low, high = region.box(np.array([0.5, 0.3]), np.array([1.0, 4.0]))  # geometric mean 2
    np.testing.assert_allclose(low, [0.4, 0.0])
    np.testing.assert_allclose(high, [0.6, 0.7])
    _, high = region.box(np.array([0.95, 0.7]), np.array([3.0, 3.0]))
    np.testing.assert_allclose(high, [1.0, 0.9])


def test_restarts_may_alternate_between_fresh_points_and_the_best_record() -> None:
    rules = dataclasses.replace(RULES, fresh_every=2)
    origins, g = [SOBOL] * 2 + [LOCAL] * 9, [31.0, 30.0] + [32.0] * 9
    around = replay(g, origins, rules)
    assert (around.restarts, around.begin, around.incumbent, around.length) == (1, 0, 1, 0.8)
    fresh = replay(g + [32.0] * 9, origins + [LOCAL] * 9, rules)
    assert (fresh.restarts, fresh.begin, fresh.incumbent) == (2, 20, None)
    # Around the best record it takes more than a better candidate than the last ones: better than that record.
    assert replay([*g, 31.0, 30.5, 30.0], [*origins, *[LOCAL] * 3], rules).length == 0.4


def test_a_restart_that_saw_no_usable_candidate_begins_elsewhere() -> None:
    rules = dataclasses.replace(RULES, fresh_every=2)
    nothing = replay([math.nan] * 9, [LOCAL] * 9, rules)
    assert (nothing.restarts, nothing.begin, nothing.incumbent) == (1, 9, None)


def test_a_restart_that_comes_too_late_to_descend_opens_the_region_around_the_best_record() -> None:
    rules = dataclasses.replace(RULES, fresh_before=11)
    origins, g = [SOBOL] * 2 + [LOCAL] * 9, [31.0, 30.0] + [32.0] * 9
    late = replay(g, origins, rules)
    assert (late.restarts, late.begin, late.incumbent, late.length) == (1, 0, 1, 0.8)
    early = replay(g, origins, dataclasses.replace(RULES, fresh_before=12))
    assert (early.restarts, early.begin, early.incumbent) == (1, 11, None)


def test_a_wave_is_one_success_or_as_many_failures_as_it_has_candidates():
    origins = [SOBOL] + [LOCAL] * 4
    assert replay([30, 31, 29, 31, 28], origins, RULES, [0, 1, 1, 2, 2]).length == 1.6
    assert replay([30, 29, 31, 31, 31], origins, RULES, [0, 1, 1, 1, 1]).length == 0.8
    assert replay([30, 31, 31, 31, 29], origins, RULES, [0, 1, 1, 1, 2]).length == 0.4
    assert replay([30, 31, 31, 31, 29], origins, RULES, [0, 1, 1, 1, 1]).length == 0.8


def test_a_restart_begins_after_the_whole_wave_that_ended_the_last_one() -> None:
    waves = [0, *(1 + k // 3 for k in range(9))]
    region = replay([30.0] + [40.0] * 9, [SOBOL] + [LOCAL] * 9, RULES, waves)
    assert (region.restarts, region.begin, region.incumbent) == (1, 10, None)
