"""Claims about a finishing stage whose ensembles grow."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bowl import problem_of, run
from softclose.propose.plan import growing, plan
from softclose.settings import ConfigError, load_config


@given(st.lists(st.integers(1, 60), min_size=1, max_size=40), st.integers(1, 500), st.integers(1, 20_000))
def test_ensembles_only_grow_and_end_with_all_switches(sizes, few, many):
    few = min(few, many)
    found = growing(sizes, few, many)
    assert len(found) == len(sizes)
    assert found == sorted(found)
    assert found[-1] == many
    assert set(found) <= {*(few * 2**k for k in range(20)), many}
    assert max(found) <= many


def test_each_size_has_an_equal_part_of_the_candidates():
    found = growing([10] * 60, 256, 8192)
    assert [found.count(n) for n in (256, 512, 1024, 2048, 4096, 8192)] == [10] * 6


def test_a_campaign_grows_its_finish_and_ends_on_the_whole_ensemble():
    settings = {"budget": 120, "n_switches": 400}
    plain, grown = (problem_of("sobol", 16, finish=settings | {"grows": grows}) for grows in (False, True))
    assert {w.n_switches for w in plan(plain) if w.stage == "finish"} == {400}
    finish = [w for w in plan(grown) if w.stage == "finish"]
    assert (finish[0].n_switches, finish[-1].n_switches) == (50, 400)
    assert {w.n_switches for w in finish} == {50, 100, 200, 400}
    assert [(w.start, w.size) for w in plan(plain)] == [(w.start, w.size) for w in plan(grown)]
    history, proposals = run(grown)
    assert [p.n_switches for p in proposals[16:]] == [w.n_switches for w in finish for _ in range(w.size)]
    assert min(o.g_cm_s for o in history[-20:]) < min(o.g_cm_s for o in history[:16])


def test_methods_that_compare_all_values_do_not_grow():
    for method in ("surrogate", "nelder-mead"):
        with pytest.raises(ConfigError, match=r"finish\.grows is true and finish\.method"):
            load_config({"finish": {"grows": True, "method": method}})
