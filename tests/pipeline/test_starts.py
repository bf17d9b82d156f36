"""Claims about the trust regions of a process without a prior: where they start, whose candidates are whose, who goes
on, and that one bad start does not lose a search."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bowl import problem_of, run
from softclose.propose.origins import LOCAL, SOBOL
from softclose.propose.regions import REGION
from softclose.propose.starts import rounds_of, starts_of
from softclose.propose.surrogate import SurrogateData
from softclose.propose.trust_region import TrustRegionRules

RULES = TrustRegionRules(initial=0.4, smallest=0.15, largest=1.6, successes=2, failures=2, improvement_cm_s=0.01)
DESIGN = (20.0, 26.0, 22.0, 21.0, 27.0, 24.0, 30.0, 23.0)
"""g of eight points of a design; the four best are 0, 3, 2 and 7."""


def known(points, g, *, regions=(), origins=None, first=0):
    """The first records are the design's, one at a place; each later one says for which region it was."""
    n, n_design = len(g), len(g) - len(regions)
    return SurrogateData(
        points=np.array(points, dtype=float),
        inputs=np.empty((n, 0)),
        g=np.array(g, dtype=float),
        origins=tuple(origins or [SOBOL] * n_design + [LOCAL] * len(regions)),
        indices=np.arange(first, first + n),
        waves=tuple([0] * n_design + list(range(1, len(regions) + 1))),
        regions=np.array([math.nan] * n_design + list(regions), dtype=float),
    )


def spread(n, dim=6):
    """n points far apart, along a diagonal."""
    return np.linspace(0.05, 0.95, n)[:, None] * np.ones(dim)


def problem(budget=88, **optimiser):
    return problem_of(budget=budget, **{"n_initial": 8, "n_starts": 4} | optimiser)


def dealt(data, start, size, pending=(), **settings):
    found = starts_of(problem(**settings), data, RULES, start=start, size=size, pending=pending)
    return {number: n for number, n in found.dealt.items() if n}, found.regions


def test_halving_has_a_quarter_of_what_follows_the_design_and_the_last_region_the_rest():
    of = rounds_of(problem(), 4)
    assert (of.counts, of.ends) == ((4, 2, 1), (18, 28, 88))
    assert (rounds_of(problem(), 1).counts, rounds_of(problem(), 1).ends) == ((1,), (88,))
    assert rounds_of(problem(), 6).counts == (6, 3, 1)
    assert rounds_of(problem(), 6).ends == (18, 28, 88)


def test_the_best_points_of_the_design_are_starts_and_have_equal_shares():
    data = known(spread(8), DESIGN)
    counts, regions = dealt(data, 8, 4)
    assert counts == {0: 1, 1: 1, 2: 1, 3: 1}
    assert [regions[n].incumbent for n in range(4)] == [0, 3, 2, 7], "the best first"
    assert dealt(data, 8, 8)[0] == {0: 2, 1: 2, 2: 2, 3: 2}, "however many other points of the design are nearest"
    assert dealt(data, 8, 3)[0] == {0: 1, 1: 1, 2: 1}
    assert dealt(data, 8, 4, n_starts=2)[0] == {0: 2, 1: 2}
    assert dealt(data, 8, 4, n_starts=1)[0] == {0: 4}


def test_starts_are_apart():
    points = spread(8)
    points[3] = points[0] + 0.09
    points[2] = points[0]
    points[2, 4] += 0.11  # and 0.02 from 3
    data = known(points, DESIGN)
    _, regions = dealt(data, 8, 4)
    assert [regions[n].incumbent for n in range(4)] == [0, 2, 7, 5], "one coordinate is enough; 3 is 0 again"
    alike = known(np.full((8, 6), 0.5), DESIGN)
    assert dealt(alike, 8, 4)[0] == {0: 4}


def test_a_candidate_in_flight_counts_for_the_region_that_is_nearest():
    data = known(spread(8), DESIGN)
    space = problem().space
    flying = space.waveforms(np.array([spread(8)[3], spread(8)[7]]) * 0.999 + 1e-4)
    at = space.coordinates_of_all(space.waveforms(spread(8)))[0]  # as the space has them
    assert dealt(known(at, DESIGN), 8, 2, flying)[0] == {0: 1, 2: 1}
    assert dealt(data, 8, 2)[0] == {0: 1, 1: 1}


def test_the_better_half_goes_on_by_what_it_found_in_the_round():
    points = np.vstack([spread(8), spread(4) + 0.01])
    data = known(points, [*DESIGN, 19.5, 20.5, 18.0, 17.0], regions=[0, 1, 2, 3])
    assert dealt(data, 17, 4)[0] == {0: 1, 1: 1, 2: 1, 3: 1}
    assert dealt(data, 18, 4)[0] == {2: 2, 3: 2}
    assert dealt(data, 28, 4)[0] == {3: 4}
    assert dealt(data, 60, 4)[0] == {3: 4}


def test_a_region_follows_its_own_records_only():
    points = np.vstack([spread(8), spread(6) + 0.01])
    g = [*DESIGN, 19.0, 30.0, 18.0, 30.0, 17.0, 16.0]
    _, regions = dealt(known(points, g, regions=[0, 1, 0, 1, 3, 2]), 14, 40)
    assert (regions[0].length, regions[0].incumbent) == (0.8, 10), "two successes"
    assert (regions[1].length, regions[1].incumbent) == (0.2, 3), "two failures"
    assert (regions[3].length, regions[3].incumbent) == (0.4, 12)
    assert (regions[2].length, regions[2].incumbent) == (0.4, 13)


def test_only_a_single_region_begins_elsewhere():
    # It shrinks to nothing within four failures (0.4, 0.2, 0.1).
    points = np.vstack([spread(8), spread(4) + 0.01])
    data = known(points, [*DESIGN, 30.0, 30.0, 30.0, 30.0], regions=[0] * 4)
    _, regions = dealt(data, 12, 40)
    assert (regions[0].restarts, regions[0].begin, regions[0].incumbent) == (1, 0, 0), "again around its best"
    _, regions = dealt(data, 12, 4, n_starts=1)
    assert (regions[0].restarts, regions[0].begin, regions[0].incumbent) == (1, 12, None)


def test_what_no_region_asked_for_belongs_to_the_nearest():
    points = np.vstack([spread(8), spread(8)[2] + 0.01])
    data = known(points, [*DESIGN, 15.0], regions=[math.nan], origins=[SOBOL] * 8 + ["by-hand"])
    _, regions = dealt(data, 12, 4)
    assert regions[2].incumbent == 8


def test_without_a_usable_point_of_the_design_the_best_of_all_are_starts():
    data = known(spread(5), [30.0, 22.0, 21.0, 25.0, 24.0], first=8)
    _, regions = dealt(data, 16, 40)
    assert [regions[n].incumbent for n in range(4)] == [2, 1, 4, 3]


@pytest.mark.parametrize(("lag", "n"), [(1, 4), (2, 3)])  # what is in flight is said to be of the nearest region
def test_every_proposal_says_for_which_region_it_is(lag, n):
    history, proposals = run(problem_of(budget=56, campaign={"lag": lag}, n_starts=4))
    assert all(REGION not in p.surrogate for p in proposals[:8])
    assert all(REGION in p.surrogate for p in proposals if p.origin == LOCAL)
    assert len({p.surrogate[REGION] for p in proposals[8:24] if p.origin == LOCAL}) == n
    assert len({p.surrogate[REGION] for p in proposals[32:] if p.origin == LOCAL}) == 1
    assert min(o.g_cm_s for o in history[8:]) < min(o.g_cm_s for o in history[:8])
