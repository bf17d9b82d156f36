"""Claims about the generator of the gest-api standard: it proposes what the campaign itself would."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from gest_api import Generator
from gest_api.vocs import VOCS

from examples import in_turn
from small_campaigns import make_campaign
from softclose.metrics.ranking import rank_cm_s
from softclose_store import open_campaign
from softclose_workflows.api.gest import OBJECTIVE, SoftcloseGenerator
from softclose_workflows.errors import BenchError

SEARCH = (
    "campaign.budget=9",
    "prior.model=none",
    "population.n_switches=40",
    "store.n_times=11",
    "optimiser.n_initial=4",
    "optimiser.batch=2",
    "optimiser.n_candidates=64",
    "explore.budget=0",
    "finish.budget=0",
)
COLUMNS = (OBJECTIVE, "g_se_cm_s", "v_u_cm_s", "mean_cm_s", "p_nc", "p_contact")


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return open_campaign(make_campaign(tmp_path_factory.mktemp("gest") / "a.zarr", *SEARCH)).records()


def generator(*settings: str) -> SoftcloseGenerator:
    chosen = (*SEARCH, *settings)
    return SoftcloseGenerator(SoftcloseGenerator.vocs_of("current", chosen), "current", chosen)


def results(points: list[dict[str, Any]], records: dict[str, Any]) -> list[dict[str, Any]]:
    return [p | {name: records[name][p["_id"]] for name in COLUMNS} for p in points]


def test_it_proposes_the_campaigns_own_waveforms(records: dict[str, Any]) -> None:
    g = generator()
    assert isinstance(g, Generator)
    assert g.returns_id
    sizes, seen = [], []
    while len(seen) < 9:
        points = g.suggest()
        sizes.append(len(points))
        for p in points:
            rows = records["waveform"][p["_id"]]
            np.testing.assert_allclose(g.waveform(p).rows(), rows[~np.isnan(rows).all(axis=1)], rtol=1e-9, atol=1e-9)
        seen += [p["_id"] for p in points]
        g.ingest(results(points, records)[::-1])  # in any order
    assert seen == list(range(9))
    assert sizes == [4, 2, 2, 1]
    for asked_for in (None, 3):
        with pytest.raises(ValueError, match="the budget is spent"):
            g.suggest(asked_for)
    g.finalize()


def test_exactly_as_many_points_as_asked_for_or_an_error(records: dict[str, Any]) -> None:
    g = generator()
    first = g.suggest(3)
    with pytest.raises(ValueError, match="3 points are asked for and 1 can be given: ingest results first"):
        g.suggest(3)
    g.ingest(results(first, records))
    (last,) = g.suggest(1)
    with pytest.raises(ValueError, match="no points"):
        g.suggest()
    g.ingest(results([last], records))
    assert [p["_id"] for p in g.suggest(2)] == [4, 5]


def test_points_lie_in_the_ranges_of_the_vocs(records: dict[str, Any]) -> None:
    g = generator()
    domains = {name: v.domain for name, v in SoftcloseGenerator.vocs_of("current", SEARCH).variables.items()}
    for point in g.suggest():
        assert set(point) == {*domains, "_id"}
        assert all(low <= point[name] <= high for name, (low, high) in domains.items())


def test_a_result_is_ingested_once_and_under_its_own_id(records: dict[str, Any]) -> None:
    g = generator()
    points = results(g.suggest(2), records)
    g.ingest(points[:1])
    for wrong in (points[:1], [points[1] | {"_id": 77}]):
        with pytest.raises(ValueError, match="is not waited for"):
            g.ingest(wrong)
    failed = [points[1] | {OBJECTIVE: math.nan}]
    g.ingest(failed)
    assert g._told[points[1]["_id"]].failed
    with pytest.raises(ValueError, match="were not suggested here"):
        g.ingest([{name: value for name, value in points[0].items() if name != "_id"}])


def without(point: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in point.items() if key != name}


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: without(p, OBJECTIVE), "has no g_cm_s; give NaN where its evaluation failed"),
        (lambda p: p | {OBJECTIVE: "soft"}, "'soft', no number"),
        (lambda p: p | {OBJECTIVE: None}, "None, no number"),
        (lambda p: p | {"p_nc": [1, 2]}, "no number"),
        (lambda p: p | {"_id": 77}, "is not waited for"),
        (lambda p: p | {"_id": "0"}, "is not waited for"),
        (lambda p: without(p, "_id"), "were not suggested here"),
        (lambda p: [p], "it must be a mapping"),
    ],
)
@pytest.mark.parametrize("place", in_turn([0, 1, 3], 3, 1))
def test_all_results_are_ingested_or_none(records: dict[str, Any], spoil: Any, words: str, place: int) -> None:
    """One without an objective lost its point for ever, and `suggest` waited for it."""
    g, twin = generator(), generator()
    points, _ = results(g.suggest(), records), twin.suggest()
    wrong = [spoil(p) if k == place else p for k, p in enumerate(points)]
    with pytest.raises(ValueError, match=words):
        g.ingest(wrong)
    with pytest.raises(ValueError, match="is not waited for"):
        g.ingest([*points, points[place]])
    g.ingest(points)
    twin.ingest(points)
    assert g.suggest() == twin.suggest()


def test_ids_may_come_back_as_a_table_has_them(records: dict[str, Any]) -> None:
    g = generator()
    points = results(g.suggest(), records)
    g.ingest([p | {"_id": kind(p["_id"])} for p, kind in zip(points, [float, np.int64, np.float64, int], strict=True)])
    assert [o.index for o in g._history] == [0, 1, 2, 3]
    mine = generator()
    mine.ingest([p | {"_id": math.nan} for p in points[:2]])
    assert [p["_id"] for p in mine.suggest()] == [2, 3]


def test_its_vocs_can_be_read() -> None:
    vocs = SoftcloseGenerator.vocs_of("current", SEARCH)
    assert SoftcloseGenerator(vocs, "current", SEARCH).vocs is vocs


def test_what_others_evaluated_comes_first(records: dict[str, Any]) -> None:
    g = generator()
    theirs = results(g.suggest(2), records)
    mine = generator()
    mine.ingest([{name: value for name, value in p.items() if name != "_id"} for p in theirs])
    rest = mine.suggest()
    assert [p["_id"] for p in rest] == [2, 3]
    mine.ingest(results(rest, records))
    assert [o.g_cm_s for o in mine._history[:2]] == [p[OBJECTIVE] for p in theirs]
    assert [o.origin for o in mine._history[:2]] == ["initial"] * 2


def test_a_vocs_that_is_not_the_searchs_is_refused() -> None:
    good = SoftcloseGenerator.vocs_of("current", SEARCH)
    wrong = [
        VOCS(variables={"x": [0.0, 1.0]}, objectives={OBJECTIVE: "MINIMIZE"}),
        VOCS(variables=good.variables, objectives={OBJECTIVE: "MAXIMIZE"}),
        VOCS(variables=good.variables, objectives={"a": "MINIMIZE", "b": "MINIMIZE"}),
        VOCS(variables=good.variables, objectives=good.objectives, constraints={"c": ["LESS_THAN", 0.0]}),
        VOCS(variables={**good.variables, "volts1": [0.0, 500.0]}, objectives=good.objectives),
    ]
    for vocs in wrong:
        with pytest.raises(ValueError, match=r"this search has|are minimised|is minimised|its range is|part of g"):
            SoftcloseGenerator(vocs, "current", SEARCH)


def test_constants_and_a_name_of_ones_own_are_kept(records: dict[str, Any]) -> None:
    good = SoftcloseGenerator.vocs_of("current", SEARCH)
    vocs = VOCS(variables=good.variables, objectives={"loss": "MINIMIZE"}, constants={"lot": 7})
    g = SoftcloseGenerator(vocs, "current", SEARCH)
    points = g.suggest()
    assert all(p["lot"] == 7 for p in points)
    g.ingest([p | {"loss": float(records[OBJECTIVE][p["_id"]])} for p in points])
    assert len(g._history) == 4


@pytest.mark.parametrize("lag", [1, 2])
def test_a_result_that_is_in_is_no_longer_in_flight(lag: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the engine is told to stay away from is what was suggested and has no result."""
    g = generator(f"campaign.lag={lag}", "campaign.budget=12")
    told: list[tuple[int, list[Any]]] = []
    real = g._proposer.propose

    def propose(wave: Any, seen: Any, pending: Any) -> Any:
        told.append((wave.start - len(seen), list(pending)))
        return real(wave, seen, pending)

    monkeypatch.setattr(g._proposer, "propose", propose)
    for _ in range(12):
        try:
            points = g.suggest()
        except ValueError:
            break
        g.ingest([p | {OBJECTIVE: 20.0 + p["_id"], "v_u_cm_s": 20.0, "p_nc": 0.0, "p_contact": 1.0} for p in points])
    assert sum(n for n, _ in told[1:]) == (0 if lag == 1 else sum(len(p) for _, p in told[1:]))
    assert [len(pending) for _, pending in told] == [n for n, _ in told]
    assert len(told) > 4


@pytest.mark.parametrize("lag", [1, 3, 6])
def test_lag_is_how_many_points_may_be_out_and_how_far_a_slow_one_is_overtaken(lag: int) -> None:
    """Asynchronous use: of points one by one, `campaign.lag` may be out; behind one that never comes back, no more."""
    g = generator(f"campaign.lag={lag}", "campaign.budget=16", "optimiser.batch=1", "optimiser.n_initial=2")

    def told(point: dict[str, Any]) -> dict[str, Any]:
        return point | {OBJECTIVE: 20.0 + point["_id"]}

    first = g.suggest(2)
    g.ingest([told(p) for p in first])
    slow = g.suggest(1)[0]
    for _ in range(lag - 1):
        g.ingest([told(p) for p in g.suggest(1)])
    with pytest.raises(ValueError, match="ingest results first"):
        g.suggest(1)
    g.ingest([told(slow)])
    assert g.suggest(1)


def proposed(g: SoftcloseGenerator, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the waves that its engine is asked for from now on."""
    sizes: list[int] = []
    real = g._proposer.propose

    def propose(wave: Any, seen: Any, pending: Any) -> Any:
        sizes.append(wave.size)
        return real(wave, seen, pending)

    monkeypatch.setattr(g._proposer, "propose", propose)
    return sizes


def test_points_of_several_waves_are_suggested_at_once_and_no_wave_before_it_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is proposed later knows more results."""
    g = generator("campaign.lag=4", "campaign.budget=16", "optimiser.batch=1", "optimiser.n_initial=2")
    sizes = proposed(g, monkeypatch)
    assert [p["_id"] for p in g.suggest(2)] == [0, 1]
    g.ingest([{"_id": i, OBJECTIVE: 20.0 + i} for i in (0, 1)])
    sizes.clear()
    assert [p["_id"] for p in g.suggest(3)] == [2, 3, 4]
    assert sizes == [1, 1, 1]
    with pytest.raises(ValueError, match="2 points are asked for and 1 can be given: ingest results first"):
        g.suggest(2)
    assert [p["_id"] for p in g.suggest(1)] == [5]
    assert sizes == [1, 1, 1, 1]


def test_the_campaign_s_own_initial_waveforms_stand_before_those_of_others(records: dict[str, Any]) -> None:
    own = [row.tolist() for row in records["waveform"][2] if not np.isnan(row).all()]
    g = generator(f"waveform.initial={[own]}")
    theirs = results(generator().suggest(2), records)
    g.ingest([without(p, "_id") for p in theirs])
    rest = g.suggest()
    assert rest[0]["_id"] == 0
    np.testing.assert_allclose(g.waveform(rest[0]).rows(), own, rtol=1e-9)
    assert [p["_id"] for p in rest] == [0, 3]
    g.ingest([p | {OBJECTIVE: 30.0} for p in rest])
    assert [o.g_cm_s for o in g._history] == [30.0, *(p[OBJECTIVE] for p in theirs), 30.0]
    for point, o in zip(theirs, g._history[1:], strict=False):
        np.testing.assert_allclose(o.waveform.rows(), g.waveform(point).rows(), rtol=1e-9)


@pytest.mark.parametrize("value", ["soft", None, [1.0, 2.0], math.nan])
def test_a_point_of_others_that_is_none_is_refused_and_nothing_is_begun(records: dict[str, Any], value: Any) -> None:
    g = generator()
    point = without(results(generator().suggest(1), records)[0], "_id")
    for wrong in (point | {"volts1": value}, without(point, "volts1")):
        with pytest.raises(BenchError, match="lacks a variable of this search, or it is no number"):
            g.ingest([point, wrong])
    assert [p["_id"] for p in g.suggest()] == [0, 1, 2, 3]


@pytest.mark.parametrize("beyond", [-0.1, 1.1])
def test_a_point_of_others_beyond_the_ranges_is_refused_and_the_ends_are_points(
    records: dict[str, Any], beyond: float
) -> None:
    """Held within them, it would be another waveform with this one's result."""
    g = generator()
    point = without(results(generator().suggest(1), records)[0], "_id")
    c = g._problem.space.coordinates[-1]
    with pytest.raises(BenchError, match=rf"{c.name} of a point is .*; it must lie in \[{c.least:g}, {c.most:g}\]"):
        g.ingest([point, point | {c.name: c.least + beyond * (c.most - c.least)}])
    assert not g._history
    g.ingest([point | {c.name: c.least}, point | {c.name: c.most}])
    assert len(g.suggest()) == 2


def test_all_that_a_result_says_is_what_the_engine_sees(records: dict[str, Any]) -> None:
    """A failed one is known as such: its engine must not take it for a parent. What is not said is no number."""
    g = generator("objective.max_open=0.1")
    points = g.suggest()
    numbers = {"g_se_cm_s": 0.5, "v_u_cm_s": 19.0, "mean_cm_s": 11.0, "p_nc": 0.25, "p_contact": 0.75}
    told = [{OBJECTIVE: 20.0} | numbers, {OBJECTIVE: math.nan}, {OBJECTIVE: 21.0}, {OBJECTIVE: math.inf} | numbers]
    g.ingest([{"_id": p["_id"]} | t for p, t in zip(points, told, strict=True)])
    full, failed, bare, infinite = g._history
    assert {name: getattr(full, name) for name in numbers} == numbers
    assert full.rank_cm_s == rank_cm_s(20.0, 0.25, g._problem.config.objective.max_open) > 20.0
    assert [o.failed for o in g._history] == [False, True, False, True]
    assert [o.usable for o in g._history] == [True, False, True, False]
    assert [o.wave for o in g._history] == [0] * 4
    assert [o.n_switches for o in g._history] == [40] * 4
    assert all(math.isnan(getattr(o, name)) for o in (failed, bare) for name in numbers)
    assert math.isinf(infinite.g_cm_s)
    assert [p["_id"] for p in g.suggest()] == [4, 5]


@pytest.mark.parametrize("engine", ["nsga2", "sobol"])
def test_a_point_that_failed_is_lost_and_the_search_goes_on(engine: str) -> None:
    """To the end of its budget, whatever share of each wave fails."""
    g = generator(f"optimiser.engine={engine}", "campaign.budget=12")
    seen = 0
    while seen < 12:
        points = g.suggest()
        seen += len(points)
        g.ingest([p | {OBJECTIVE: math.nan if p["_id"] % 2 else 20.0, "p_nc": 0.0} for p in points])
    assert sum(o.usable for o in g._history) == 6
