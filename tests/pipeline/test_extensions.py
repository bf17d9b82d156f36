"""Claims about extensions of a finished campaign: stages after all others, each as large as it was asked for."""

from __future__ import annotations

import pytest

from bowl import problem_of
from softclose.propose.extensions import extensions
from softclose.propose.extensions import problem_of as seen_by_an_extension
from softclose.propose.promises import PriorValues

ADDED = {"extensions": [6, [3, 7], 4]}


@pytest.mark.parametrize(
    ("more", "engine", "first", "n_switches"),
    [
        ({}, "sobol", 8, 50),
        ({"explore": {"budget": 48}}, "extend", 56, 50),
        ({"finish": {"budget": 9, "n_switches": 300}}, "extend", 17, 300),
        ({"explore": {"budget": 24}, "finish": {"budget": 24, "n_switches": 20}}, "extend", 56, 50),
    ],
)
def test_extensions_follow_all_other_stages_on_the_largest_ensemble(
    more: dict[str, dict[str, int]], engine: str, first: int, n_switches: int
) -> None:
    """A search goes on where the campaign ended with it; after descents there is another one."""
    config = problem_of("sobol", 8, campaign=ADDED, **more).config
    found = extensions(config)
    assert list(found) == ["extend1", "extend2", "extend3"]
    assert [e.stage for e in found.values()] == list(found)
    assert [(e.begin, e.size) for e in found.values()] == [(first, 6), (first + 6, 2), (first + 8, 4)]
    assert [e.again for e in found.values()] == [(), (3, 7), ()]
    assert [e.engine for e in found.values()] == [engine, "retry", engine]
    assert [e.is_search for e in found.values()] == [engine == "sobol", False, engine == "sobol"]
    assert {e.n_switches for e in found.values()} == {n_switches}


def test_a_campaign_without_extensions_has_none() -> None:
    assert extensions(problem_of("sobol", 8).config) == {}


class Asked:
    """A prior that says what it is asked."""

    def basins(self) -> object:
        return BASINS

    def values(self, waveforms: object, n_switches: int | None = None) -> object:
        return PriorValues(g_cm_s=waveforms, failure=f"{n_switches}")  # type: ignore[arg-type]


BASINS = object()


def test_a_search_that_goes_on_sees_a_campaign_that_is_as_large_from_the_beginning() -> None:
    """And the same prior, which is not looked for again."""
    problem = problem_of(campaign=ADDED, prior={"model": "single-mode"})
    problem = type(problem)(problem.config, help=Asked())  # type: ignore[arg-type]
    for extension, budget in zip(extensions(problem.config).values(), (30, None, 36), strict=True):
        found = seen_by_an_extension(problem, extension)
        if budget is None:
            assert found is problem
            continue
        assert found.config.campaign.budget == budget
        assert found.config.campaign.extensions == ()
        assert found.config.optimiser == problem.config.optimiser
        assert found.basins is BASINS
        assert found.prior_values("these", 7) == PriorValues(g_cm_s="these", failure="7")  # type: ignore[arg-type]
        assert found.prior_values("these").failure == "None"  # type: ignore[arg-type]
