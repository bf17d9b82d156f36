"""Claims about a store in the hands of who has nothing but xarray: names join, units are told, nothing hides."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from numpy.testing import assert_array_equal

import small_store
from small_store import CONFIG, FINISH, SEARCH, block, create, layout, population, recompute, run, write_wave
from softclose_store import (
    CaseColumn,
    Constant,
    DriverStore,
    GroupArray,
    Layout,
    LayoutError,
    PopulationColumn,
    RecordError,
    StageLayout,
    create_campaign,
    groups,
    list_groups,
    open_campaign,
    proposals_digest,
    read_group,
    repair,
    verify,
    write_block,
    write_group,
)

GROUP = "certification/9-1"


def tree_of(path: Path) -> Any:
    return xr.open_datatree(path, engine="zarr", chunks=None)


def shown(path: Path) -> set[str]:
    return {name.lstrip("/") for name in tree_of(path).groups}


def certify(path: Any, n: int = 9, **options: Any) -> None:
    speed = GroupArray(dims=("fresh_switch",), values=np.arange(float(n)), unit="cm/s", long_name="speed")
    write_group(path, GROUP, {"speed": speed}, {"n": n}, **options)


def test_switches_and_candidates_have_one_name_and_one_number_in_every_group(whole: Path) -> None:
    tree = tree_of(whole)
    groups = [tree[name] for name in ("candidates", "population", "search", "finish")]
    dims = {str(dim) for group in groups for dim in group.dims}
    assert {dim for dim in dims if "switch" in dim} == {"switch", "block_switch"}
    assert {dim for dim in dims if "candidate" in dim} == {"candidate", "block_candidate"}
    assert_array_equal(tree["population"].switch, np.arange(12))
    assert_array_equal(tree["candidates"].candidate, np.arange(8))
    assert_array_equal(tree["search"].candidate, np.arange(5))
    assert_array_equal(tree["finish"].candidate, np.arange(5, 8))
    assert_array_equal(tree["search"].switch, np.arange(10))


def test_nothing_broadcasts_in_silence(whole: Path) -> None:
    """Arrays of ensembles of different sizes join by the numbers of their switches: the first of the larger one."""
    tree = tree_of(whole)
    lot, first, last = tree["population"], tree["search"], tree["finish"]
    clearance = lot.D - first.x.max("time")
    assert dict(clearance.sizes) == {"switch": 10, "candidate": 5}
    assert_array_equal(clearance.sel(switch=3), lot.D[3].to_numpy() - first.x[:, 3].max("time").to_numpy())
    both = first.x.isel(candidate=0, drop=True) - last.x.isel(candidate=0, drop=True)
    assert dict(both.sizes) == {"switch": 10, "time": 11}
    product = first.x * last.x  # they share no candidate
    assert product.sizes["candidate"] == 0
    g = tree["candidates"].records.sel(field="g_cm_s")
    assert_array_equal((g + 0 * last.x.max(["switch", "time"])).to_numpy(), g[5:])
    assert_array_equal(g.where(tree["candidates"].stage == "finish", drop=True).candidate, [5, 6, 7])


def test_the_best_is_found_whatever_stages_there_are(tmp_path: Path) -> None:
    for name, stages in (("both", (SEARCH, FINISH)), ("finish only", (FINISH,))):
        path = tmp_path / f"{name}.zarr"
        create(path, layout(stages))
        n = open_campaign(path).budget
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(small_store, "WAVES", {**small_store.WAVES, **({} if n == 8 else {0: 2, 2: 1})})
            patch.setattr(small_store, "USED", small_store.USED if n == 8 else {})
            run(path, n)
        records = tree_of(path)["candidates"].records
        sizes = records.sel(field="n_switches")
        best = records.sel(field="rank_cm_s").where(sizes == sizes.max()).idxmin("candidate")
        assert int(best) == open_campaign(path).best().candidate
        stage = str(tree_of(path)["candidates"].stage.sel(candidate=best).values)
        x = tree_of(path)[stage].x.sel(candidate=best)
        assert_array_equal(x, open_campaign(path).trajectories(int(best)).x[...])


def columns_without_labels(tree: Any) -> list[str]:
    """Arrays that hold columns of which nothing says name or unit."""
    wanted = []
    for node in tree.subtree:
        for name, array in node.data_vars.items():
            dim = array.dims[-1] if array.ndim else ""
            if dim in ("field", "wall_time", "hyperparameter", "quantity", "impact_quantity"):
                labels = [dim] if name.startswith(str(dim)) else [dim, f"{dim}_unit"]
            else:
                labels = [dim] if dim in ("word", "digest", "marker", "parameter") else []
            wanted += [f"{node.path}/{name}: {label}" for label in labels if label not in node.variables]
            if array.attrs.get("units", "") in ("", "see"):
                wanted.append(f"{node.path}/{name}: units")
    return wanted


def test_every_column_has_a_name_and_a_unit(whole: Path) -> None:
    tree = tree_of(whole)
    assert columns_without_labels(tree) == []
    tables = tree["candidates"]
    assert dict(zip(tables.wall_time.values, tables.wall_time_unit.values, strict=True))["wall_check"] == "1"
    assert str(tables.wall_times.sel(wall_time="wall_propose_s").wall_time_unit.values) == "s"
    assert list(tree["search"].impact.impact_quantity_unit.values) == ["µs", "µm/µs"]
    assert list(tables.hyperparameter_unit.values) == ["1", "1"]
    assert str(tables.field_unit.sel(field="v_u_cm_s").values) == "cm/s"


def test_a_surrogates_quantity_is_told_in_the_unit_that_its_name_ends_with(tmp_path: Path) -> None:
    create(tmp_path / "a.zarr")
    said = {"predicted_std_cm_s": 1.0, "length_scale_p1_rise_us": 2.0, "noise": 3.0}
    with DriverStore(tmp_path / "a.zarr") as driver:
        markers = write_wave(driver, 0)
        driver.commit([row | {"surrogate": said} for row in small_store.rows(driver.layout, 0)], markers)
    data = xr.open_zarr(tmp_path / "a.zarr", group="candidates", chunks=None)
    assert list(data.hyperparameter.values) == list(said)
    assert list(data.hyperparameter_unit.values) == ["cm/s", "µs", "1"]
    assert verify(tmp_path / "a.zarr").ok


def test_two_campaigns_join(whole: Path, tmp_path: Path) -> None:
    """No label is blank and none comes twice, whatever was said in which of them."""
    other = tmp_path / "b.zarr"
    create(other, layout(n_pulses=3, limits_cm_s=(10.0,)), config=CONFIG | {"other": 1})
    with DriverStore(other) as driver:
        markers = write_wave(driver, 0)
        driver.commit([row | {"surrogate": {"other": 1.0}} for row in small_store.rows(driver.layout, 0)], markers)
    none = tmp_path / "c.zarr"
    create(none)
    tables = [xr.open_zarr(path, group="candidates", chunks=None) for path in (whole, other, none)]
    for table in tables:
        for name, index in table.indexes.items():
            assert index.is_unique, name
            assert "" not in index, name
    joined = xr.concat([t[["records", "surrogate"]] for t in tables], dim="campaign", join="outer")
    assert dict(joined.sizes) == {"campaign": 3, "candidate": 8, "field": 51 + 4 + 10, "hyperparameter": 3}
    assert set(joined.hyperparameter.values) == {"noise", "other", "scale"}
    assert_array_equal(joined.surrogate.sel(campaign=1, hyperparameter="other")[:4], 1.0)


def test_constants_are_told_with_their_units(tmp_path: Path) -> None:
    constants = {"epsilon_0": Constant(8.85e-12, "F/m", "permittivity of the gap")}
    sizes = layout()
    create_campaign(
        tmp_path / "a.zarr", layout=sizes, config=CONFIG, population=population(), algorithm="a", constants=constants
    )
    told = {"epsilon_0": {"value": 8.85e-12, "units": "F/m", "long_name": "permittivity of the gap"}}
    assert tree_of(tmp_path / "a.zarr").attrs["constants"] == told
    (tmp_path / "a.zarr" / "zarr.json").unlink()
    assert repair(tmp_path / "a.zarr", recompute()).ok
    assert tree_of(tmp_path / "a.zarr").attrs["constants"] == told


def test_the_history_says_stage_engine_and_size_of_the_ensemble(tmp_path: Path) -> None:
    from dataclasses import replace

    create(tmp_path / "a.zarr", layout((replace(SEARCH, engine="skopt"), replace(FINISH, engine="cmaes"))))
    run(tmp_path / "a.zarr")
    history = open_campaign(tmp_path / "a.zarr").history()
    assert list(history["stage"]) == ["search"] * 5 + ["finish"] * 3
    assert list(history["engine"]) == ["skopt"] * 5 + ["cmaes"] * 3
    assert list(history["n_switches"]) == [10, 10, 10, 10, 7, 12, 12, 12]
    tables = tree_of(tmp_path / "a.zarr")["candidates"]
    for name in ("stage", "engine"):
        assert list(tables[name].values) == list(history[name])
    assert tree_of(tmp_path / "a.zarr")["finish"].attrs["engine"] == "cmaes"


# Result groups.


def test_a_result_group_joins_the_tree_and_goes_with_its_replacement(store: Path) -> None:
    assert GROUP not in shown(store)
    certify(store)
    assert_array_equal(tree_of(store)[GROUP].speed, np.arange(9.0))
    assert tree_of(store)[GROUP].attrs["n"] == 9
    assert_array_equal(open_campaign(store).datatree()[GROUP].speed, np.arange(9.0))
    certify(store, 4, replace=True)
    assert_array_equal(tree_of(store)[GROUP].speed, np.arange(4.0))
    assert verify(store).ok
    assert verify(store).unlisted == ()


def test_the_list_outlives_commits_notes_and_extensions(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    create(path)
    certify(path)
    with DriverStore(path) as driver:
        driver.note_run({"host": "here"})
        small_store.run_wave(driver)
    assert GROUP in shown(path)
    run(path)
    assert_array_equal(tree_of(path)[GROUP].speed, np.arange(9.0))


def test_a_group_that_is_written_beside_a_driver_is_listed_when_that_one_is_done(store: Path) -> None:
    with DriverStore(store):
        certify(store)
        assert GROUP not in shown(store)
        assert list_groups(store) == [GROUP]
        report = verify(store)
        assert (report.ok, report.unlisted) == (True, (GROUP,))
        assert_array_equal(read_group(store, GROUP).arrays["speed"], np.arange(9.0))
        assert_array_equal(open_campaign(store).datatree()[GROUP].speed, np.arange(9.0))
    assert_array_equal(tree_of(store)[GROUP].speed, np.arange(9.0))
    assert verify(store).unlisted == ()


@pytest.mark.parametrize("mend", ["open", "repair"])
def test_a_group_whose_writer_was_killed_before_the_list_is_listed_by_the_next(
    store: Path, mend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softclose_store.groups.list_groups_again", lambda path, but="": None)
    certify(store)
    monkeypatch.undo()
    assert GROUP not in shown(store)
    assert verify(store).ok
    if mend == "open":
        DriverStore(store).close()
    else:
        assert repair(store, recompute()).ok
    assert GROUP in shown(store)


def test_at_every_instant_of_a_replacement_the_tree_shows_a_whole_group_or_none(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers of the list would take fill values, or the one group's values for the other's."""
    certify(store)
    seen: list[list[float] | None] = []
    steps = {"write_key": groups.write_key, "delete_key": groups.delete_key}

    def look() -> None:
        tree = tree_of(store)
        if f"/{GROUP}" in tree.groups:
            seen.append(tree[GROUP].speed.to_numpy().tolist())
        else:
            seen.append(None)

    for name, step in steps.items():
        monkeypatch.setattr(groups, name, lambda *a, step=step: (look(), step(*a), look())[1])
    certify(store, 4, replace=True)
    look()
    assert seen[-1] == [0, 1, 2, 3]
    assert {tuple(values) for values in seen if values is not None} <= {tuple(range(9)), tuple(range(4))}
    assert None in seen


def test_a_group_that_is_listed_and_gone_is_told_and_taken_off_the_list(store: Path) -> None:
    certify(store)
    shutil.rmtree(store / "certification")
    assert not np.isnan(tree_of(store)[GROUP].speed).any()  # zarr takes what is lost for fill values
    told = [str(problem) for problem in verify(store).problems]
    assert told == [f"listing: the root lists {GROUP}, which is not there"]
    from softclose_store import DamageError

    with pytest.raises(DamageError, match="is listed in the root, and not there"):
        open_campaign(store).datatree()
    assert repair(store, recompute()).ok
    assert GROUP not in shown(store)
    assert set(open_campaign(store).datatree().groups) == {"/"} | {f"/{name}" for name in shown(store) if name}


def test_a_damaged_array_of_a_group_is_told_by_our_own_tree(store: Path) -> None:
    from softclose_store import DamageError

    certify(store)
    file = store / GROUP / "speed" / "c" / "0"
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(DamageError, match=r"speed/c/0 of .* is not what was written"):
        open_campaign(store).datatree()[GROUP].speed.to_numpy()


@pytest.mark.parametrize(
    ("entry", "value"),
    [("certification/../x", {"node_type": "group"}), ("certification/1", {"node_type": "group", "zarr_format": 3})],
)
def test_a_list_that_somebody_made_up_is_refused(store: Path, entry: str, value: Any) -> None:
    import json

    from softclose_store import DamageError
    from softclose_store.schema.root import Root

    document = json.loads((store / "zarr.json").read_bytes())
    document["consolidated_metadata"]["metadata"][entry] = value
    (store / "zarr.json").write_bytes(Root(document).encode())
    with pytest.raises(DamageError, match="is no root of a store"):
        open_campaign(store)


# What is ahead: cases, modes, designs.

CASES = (CaseColumn("celsius", "°C", "temperature of the case", (-40.0, 20.0, 85.0)),)
DESIGNS = (PopulationColumn("D", "µm", "travel to contact"), PopulationColumn("G", "µm", "electrostatic gap"))
RICH = StageLayout(name="search", n_candidates=4, n_switches=6, block_candidates=2, block_switches=3)


def rich(**changes: Any) -> Layout:
    return layout((RICH,), **({"cases": CASES, "n_modes": 3, "designs": DESIGNS} | changes))


def rich_row(i: int) -> dict[str, Any]:
    design = {"D": 2.0 + i} if i % 2 else {"D": 2.5, "G": 3.0}
    return small_store.proposal(i, 6) | {"design": design} | small_store.record(i)


@pytest.fixture(scope="module")
def rich_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rich") / "a.zarr"
    sizes = create(path, rich())
    with DriverStore(path) as driver:
        rows = [rich_row(i) for i in range(4)]
        markers = {}
        for i in range(2):
            designs = [[row["design"].get(c.name, np.nan) for c in DESIGNS] for row in rows[2 * i : 2 * i + 2]]
            digest = proposals_digest([r["waveform"] for r in rows[2 * i : 2 * i + 2]], 6, 2 * i, designs)
            markers |= {
                (i, j): write_block(path, "search", i, j, block(sizes, "search", i, j), digest) for j in range(2)
            }
        driver.commit(rows, markers)
    return path


def test_every_case_and_mode_has_its_axis_and_its_coordinates(rich_store: Path) -> None:
    stage = tree_of(rich_store)["search"]
    assert stage.x.dims == ("candidate", "switch", "time")
    assert stage.case_x.dims == ("candidate", "switch", "case", "time")
    assert stage.case_response.dims == ("candidate", "switch", "case", "quantity")
    assert stage.case_impact.dims == ("candidate", "switch", "case", "event", "impact_quantity")
    assert stage.mode_v.dims == ("candidate", "switch", "mode", "time")
    assert stage.case_mode_x.dims == ("candidate", "switch", "case", "mode", "time")
    assert_array_equal(stage.mode, [2, 3])
    assert_array_equal(stage.case_x.celsius, [-40.0, 20.0, 85.0])
    assert stage.celsius.attrs["units"] == "°C"
    warm = stage.case_x.swap_dims(case="celsius").sel(celsius=85.0)
    assert_array_equal(warm[1, 4], block(rich(), "search", 0, 1)["case_x"][1, 1, 2])
    assert columns_without_labels(tree_of(rich_store)) == []
    assert verify(rich_store).ok


def test_every_candidate_may_have_a_design_of_its_own(rich_store: Path) -> None:
    tables = tree_of(rich_store)["candidates"]
    records = tables.records
    assert_array_equal(records.sel(field="design_D"), [2.5, 3.0, 2.5, 5.0])
    assert_array_equal(records.sel(field="design_G"), [3.0, np.nan, 3.0, np.nan])
    assert str(tables.field_unit.sel(field="design_D").values) == "µm"
    history = open_campaign(rich_store).history()
    assert_array_equal(history["design_D"], records.sel(field="design_D"))
    assert_array_equal(history["n_switches"], [6] * 4)


def test_blocks_of_another_design_are_other_blocks(tmp_path: Path) -> None:
    sizes = create(tmp_path / "a.zarr", rich(cases=(), n_modes=1))
    rows = [rich_row(i) for i in range(2)]
    waveforms = [row["waveform"] for row in rows]
    with DriverStore(tmp_path / "a.zarr") as driver:
        digest = proposals_digest(waveforms, 6, 0, [[2.5, 3.0], [9.0, np.nan]])
        markers = {
            (0, j): write_block(tmp_path / "a.zarr", "search", 0, j, block(sizes, "search", 0, j), digest)
            for j in range(2)
        }
        with pytest.raises(RecordError, match="are not stored, or of other proposals"):
            driver.commit(rows, markers)
        driver.commit([rows[0], rows[1] | {"design": {"D": 9.0}}], markers)
        with pytest.raises(RecordError, match="the design says T; candidates of this campaign may have D, G"):
            driver.commit([rich_row(2) | {"design": {"T": 1.0}}], {})


@pytest.mark.parametrize(
    "changes",
    [
        {"cases": (CaseColumn("time", "1", "taken", (1.0,)),)},
        {"cases": (CASES[0], CaseColumn("volts", "V", "as many", (1.0,)))},
        {"cases": (CaseColumn("celsius", "°C", "none", ()),)},
        {"n_modes": 0},
        {"designs": (DESIGNS[0], DESIGNS[0])},
    ],
)
def test_cases_modes_and_designs_that_cannot_be_are_refused(changes: Any) -> None:
    with pytest.raises(LayoutError):
        rich(**changes)


def test_zarr_alone_opens_every_array_of_the_list(rich_store: Path) -> None:
    group = zarr.open_group(rich_store, mode="r")
    names = [name for name, node in group.members(max_depth=None) if isinstance(node, zarr.Array)]
    assert {"search/case_mode_v", "population/D", "candidates/records"} <= set(names)
    for name in names:
        np.asarray(group[name][...])  # type: ignore[index]
