"""Claims about layouts and the creation of stores."""

import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr

import small_store
import softclose_store.write.create as create_module
from small_store import ALGORITHM, CONFIG, SEARCH, create, layout, population
from softclose_store import (
    DamageError,
    DriverStore,
    LayoutError,
    LockedError,
    OtherAlgorithmError,
    OtherConfigurationError,
    RecordError,
    SchemaError,
    StageLayout,
    StoreError,
    StoreExistsError,
    StoreMissingError,
    create_campaign,
    fingerprint_of,
    open_campaign,
    store_state,
    verify,
    write_block,
)

GOLDEN = Path(__file__).parent / "golden"


def new_campaign(path, sizes=None, **changes):
    options = {"config": CONFIG, "population": population(), "algorithm": ALGORITHM}
    create_campaign(path, layout=sizes or layout(), **(options | changes))


def test_a_new_store_opens_everywhere_with_no_candidate_and_no_warning(tmp_path):
    path = tmp_path / "new.zarr"
    create(path)
    assert xarray.open_zarr(path, group="candidates").sizes["candidate"] == 0
    assert xarray.open_datatree(path, engine="zarr")["finish"].x.shape == (0, 12, 11)
    assert zarr.open_group(path, mode="r")["search/x"].shape == (0, 10, 11)
    campaign = open_campaign(path)
    assert (campaign.committed, campaign.budget, campaign.n_waves, campaign.finished) == (0, 8, 0, False)
    assert campaign.stages == {"search": 0, "finish": 0}
    assert campaign.best() is None
    assert len(campaign.history()) == 0
    assert campaign.config == CONFIG
    assert campaign.algorithm == ALGORITHM
    assert campaign.fingerprint == fingerprint_of(CONFIG)
    assert campaign.runtime["host"] == "here"


def test_a_block_that_cannot_be_cut_is_refused_with_advice():
    with pytest.raises(LayoutError, match=r"no divisor between 128 and 8192; use a multiple of 128, for example 10112"):
        replace(SEARCH, n_switches=50_000, block_switches=10_007)


@pytest.mark.parametrize(
    ("block", "inner"),
    [
        ((20, 256), (20, 256)),
        ((1, 8192), (1, 8192)),
        ((64, 256), (32, 256)),
        ((2, 8192), (1, 8192)),
        ((1, 15_625), (1, 3125)),
    ],
)
def test_an_inner_chunk_holds_at_most_8192_trajectories_and_divides_its_block(block, inner):
    stage = StageLayout(
        name="a", n_candidates=640, n_switches=4 * block[1], block_candidates=block[0], block_switches=block[1]
    )
    assert stage.inner == inner


def test_too_many_blocks_are_refused():
    with pytest.raises(LayoutError, match="at most 256 are allowed"):
        replace(SEARCH, n_switches=100_000, block_switches=10)


@pytest.mark.parametrize("field", ["n_candidates", "n_switches", "block_candidates", "block_switches", "n_pulses"])
@pytest.mark.parametrize("value", [0, -1, 2.5, True, "3"])
def test_sizes_are_positive_integers(field, value):
    with pytest.raises(LayoutError, match=field):
        layout(**{field: value}) if field == "n_pulses" else replace(SEARCH, **{field: value})


@pytest.mark.parametrize(
    "name", ["", "Search", "a/b", "..", "runtime", "candidates", "population", "prior", "search ", 3]
)
def test_a_stages_name_is_a_plain_name(name):
    with pytest.raises(LayoutError, match="a stage is called"):
        replace(SEARCH, name=name)


def test_stages_have_different_names_and_there_is_one():
    for stages in ((), (SEARCH, SEARCH)):
        with pytest.raises(LayoutError, match="one or more"):
            layout(stages)


def test_times_must_increase():
    with pytest.raises(LayoutError, match="increasing"):
        layout(times_us=np.array([0.0, 2.0, 1.0]))


def test_limits_are_stored_once_and_named_apart():
    with pytest.raises(LayoutError, match="stored once"):
        layout(limits_cm_s=(20.0, 20))
    names = [field.name for field in layout(limits_cm_s=(20.0000001, 20.0)).fields]
    assert names.count("p_exceed_20.0") == names.count("p_exceed_20.0000001") == 1
    assert "p_exceed_20" in [field.name for field in layout(limits_cm_s=(20.0, 15.0)).fields]


def test_a_candidate_belongs_to_the_stage_that_its_index_falls_into():
    sizes = layout()
    found = [(stage.name, local) for stage, local in map(sizes.stage_of, range(8))]
    assert found == [*(("search", i) for i in range(5)), *(("finish", i) for i in range(3))]
    assert [sizes.first(name) for name in ("search", "finish")] == [0, 5]
    for outside in (-1, 8):
        with pytest.raises(RecordError, match="budget of 8"):
            sizes.stage_of(outside)
    with pytest.raises(LayoutError, match="no stage 'polish'"):
        sizes.stage("polish")


def test_waves_begin_and_end_with_a_block():
    sizes = layout()
    assert sizes.wave_blocks(0, 4, 10) == [(i, j) for i in range(2) for j in range(3)]
    assert sizes.wave_blocks(4, 1, 5) == [(2, 0), (2, 1)]
    assert sizes.wave_blocks(5, 2, 12) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for start, size in ((0, 3), (1, 3)):
        with pytest.raises(RecordError, match="cuts a block of 2 candidates in two"):
            sizes.wave_blocks(start, size, 10)
    with pytest.raises(RecordError, match="does not lie in stage search, which has 1 left"):
        sizes.wave_blocks(4, 2, 10)
    with pytest.raises(RecordError, match="1 to 10 switches"):
        sizes.wave_blocks(0, 4, 11)


def test_the_population_must_fit(tmp_path):
    with pytest.raises(LayoutError, match="shape"):
        new_campaign(tmp_path / "a", population=population(9))
    with pytest.raises(LayoutError, match="columns"):
        new_campaign(tmp_path / "a", population={"D": np.ones(12)})
    assert not list(tmp_path.iterdir())


def test_an_empty_path_and_a_configuration_that_is_no_json_are_refused(tmp_path):
    with pytest.raises(StoreError, match="empty"):
        create("")
    with pytest.raises(StoreError, match="JSON"):
        create(tmp_path / "a", config={"a": float("nan")})


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StoreError, match="cannot create a store at"):
        create(tmp_path / "file" / "a.zarr")


def test_an_empty_folder_may_become_a_store_but_nothing_else_may(tmp_path):
    (tmp_path / "empty").mkdir()
    create(tmp_path / "empty")
    assert store_state(tmp_path / "empty").kind == "campaign"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("precious")
    with pytest.raises(StoreExistsError, match="no Softclose store"):
        create(tmp_path / "full")
    zarr.create_group(tmp_path / "other.zarr")
    with pytest.raises(StoreExistsError, match="no Softclose store"):
        create(tmp_path / "other.zarr")
    assert (tmp_path / "full" / "thesis.tex").read_text() == "precious"


def test_the_same_campaign_is_not_created_twice_and_the_message_says_resume(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    with pytest.raises(StoreExistsError, match=r"0 of 8 candidates: continue it with `softclose resume"):
        create(path)
    create(path, exist_ok=True)
    small_store.run(path)
    with pytest.raises(StoreExistsError, match="finished"):
        create(path)


def test_another_configuration_is_refused_and_the_message_names_what_differs(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    changed = {"campaign": {"seed": 8, "budget": 8}, "model": {"horizon_us": 250.0, "restitution": 0.4}}
    with pytest.raises(OtherConfigurationError) as error:
        create(path, config=changed)
    assert "campaign.seed: the store has 7, this configuration 8" in str(error.value)
    assert "model.restitution: the store has nothing, this configuration 0.4" in str(error.value)
    assert "budget" not in str(error.value)
    with pytest.raises(OtherConfigurationError):
        DriverStore(path, expected_fingerprint=fingerprint_of(changed))


def test_other_algorithms_do_not_continue_a_campaign_but_may_find_it_finished(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    for use in (
        lambda: create(path, algorithm="waves-2", exist_ok=True),
        lambda: DriverStore(path, expected_algorithm="waves-2"),
    ):
        with pytest.raises(OtherAlgorithmError, match=r"begun with version 'waves-1' .* this program has 'waves-2'"):
            use()
    DriverStore(path, expected_algorithm=ALGORITHM).close()
    assert store_state(path).algorithm == ALGORITHM
    small_store.run(path)
    create(path, algorithm="waves-2", exist_ok=True)


def test_a_fingerprint_that_is_not_the_configurations_is_refused(tmp_path):
    with pytest.raises(StoreError, match="fingerprint"):
        new_campaign(tmp_path / "a", fingerprint="00")


def test_a_newer_schema_version_is_refused_by_name(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    document = json.loads((path / "zarr.json").read_text())
    document["attributes"]["softclose_schema"] = 4
    (path / "zarr.json").write_text(json.dumps(document))
    for use in (open_campaign, DriverStore, store_state, lambda p: create(p)):
        with pytest.raises(SchemaError, match=r"schema version 4; this version of softclose reads 3: upgrade"):
            use(path)


@pytest.mark.parametrize("version", [1, 2])
def test_a_store_of_an_older_schema_is_refused_by_name_and_the_message_says_what_to_do(tmp_path, version):
    path = tmp_path / "golden.zarr"
    with zipfile.ZipFile(GOLDEN / f"version-{version}.zip") as archive:
        archive.extractall(path)
    for use in (open_campaign, DriverStore, store_state, verify, lambda p: create(p)):
        with pytest.raises(SchemaError, match=rf"schema version {version}.*read the store with that one, or run its"):
            use(path)


def test_a_path_without_a_store_says_so(tmp_path):
    for use in (open_campaign, DriverStore):
        with pytest.raises(StoreMissingError, match="no campaign at"):
            use(tmp_path / "nothing.zarr")
    assert not list(tmp_path.iterdir())


def test_a_creation_killed_half_way_leaves_nothing_at_the_path_and_its_remains_are_removed(tmp_path):
    code = "import sys, small_store; small_store.create(sys.argv[1])"
    environment = os.environ | {"SOFTCLOSE_FAULT": "inside-creation:1", "PYTHONPATH": os.pathsep.join(sys.path)}
    killed = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.zarr")], env=environment, check=False)
    assert killed.returncode == -9
    assert not (tmp_path / "a.zarr").exists()
    assert [p.name.startswith("a.zarr.creating-") for p in tmp_path.iterdir()] == [True]
    create(tmp_path / "a.zarr")
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


def test_an_unfinished_creation_at_the_path_itself_is_recognised_and_begun_anew(tmp_path):
    create(tmp_path / "a.zarr")
    for key in ("zarr.json", "candidates/digests/root.json"):  # what an interrupted creation behind a URL leaves
        (tmp_path / "a.zarr" / key).unlink()
    assert store_state(tmp_path / "a.zarr").kind == "unfinished"
    with pytest.raises(StoreMissingError, match="unfinished creation"):
        open_campaign(tmp_path / "a.zarr")


@pytest.mark.parametrize("lost", [["zarr.json"], ["zarr.json", "candidates/digests/root.json"]])
def test_a_missing_root_beside_data_is_damage_and_nothing_is_created_over_it(tmp_path, lost):
    path = tmp_path / "a.zarr"
    create(path)
    small_store.run(path, 4)
    for key in lost:
        (path / key).unlink()
    assert store_state(path).kind == "damaged"
    for use in (open_campaign, DriverStore, create):
        with pytest.raises(DamageError, match="that file was lost"):
            use(path)
    assert (path / "candidates" / "records" / "c.0.0").exists()


def test_a_creation_behind_a_url_that_was_killed_is_begun_anew(monkeypatch):
    url = "memory://test-creation-killed/a.zarr"
    monkeypatch.setenv("SOFTCLOSE_FAULT", "inside-creation:1:raise-enospc")
    monkeypatch.setattr("softclose_store.faults._passages", __import__("collections").Counter())
    with pytest.raises(OSError, match="No space left"):
        create(url)
    assert store_state(url).kind == "unfinished"
    create(url)
    assert store_state(url).kind == "campaign"


def test_the_store_of_a_url_is_like_a_local_one():
    url = "memory://test-creation/a.zarr"
    assert store_state(url).kind == "absent"
    create(url)
    with pytest.raises(StoreExistsError):
        create(url)
    small_store.run(url)
    best = open_campaign(url).best()
    assert best is not None
    assert best.candidate == 7
    assert xarray.open_zarr(url, group="candidates").sizes["candidate"] == 8
    assert verify(url).ok


def test_a_block_is_a_handful_of_files_however_many_candidates_and_switches_it_holds(tmp_path):
    counts = []
    for n_candidates, n_switches in ((2, 8), (20, 256)):
        stage = StageLayout(
            name="search",
            n_candidates=n_candidates,
            n_switches=n_switches,
            block_candidates=n_candidates,
            block_switches=n_switches,
        )
        path = tmp_path / str(n_switches)
        sizes = create(path, layout([stage]))
        before = sum(1 for p in path.rglob("*") if p.is_file())
        write_block(path, "search", 0, 0, small_store.block(sizes, "search", 0, 0), 1)
        counts.append(sum(1 for p in path.rglob("*") if p.is_file()) - before)
    assert counts == [5, 5]


@pytest.mark.parametrize("exist_ok", [False, True])
def test_the_slower_of_two_that_begin_the_same_campaign_is_told_to_wait(tmp_path, monkeypatch, exist_ok):
    """It was told to give another path, which would have run the campaign twice."""
    path, other = tmp_path / "a.zarr", tmp_path / "b.zarr"
    write_all = create_module._write_all

    def faster(files, hierarchy):
        write_all(files, hierarchy)
        monkeypatch.setattr(create_module, "_write_all", write_all)
        create(other)  # the other driver's, between writing and appearing; a process of its own has its own folder
        os.rename(other, path)

    monkeypatch.setattr(create_module, "_write_all", faster)
    if exist_ok:
        create(path, exist_ok=True)
    else:
        with pytest.raises(LockedError, match=r"another driver has just begun .* wait for it .*softclose resume"):
            create(path)
    assert store_state(path).kind == "campaign"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zarr"]


def test_the_slower_of_two_different_campaigns_is_told_what_differs(tmp_path, monkeypatch):
    path, other = tmp_path / "a.zarr", tmp_path / "b.zarr"
    write_all = create_module._write_all

    def faster(files, hierarchy):
        write_all(files, hierarchy)
        monkeypatch.setattr(create_module, "_write_all", write_all)
        create(other, config={"campaign": {"seed": 77, "budget": 8}, "model": CONFIG["model"]})
        os.rename(other, path)

    monkeypatch.setattr(create_module, "_write_all", faster)
    with pytest.raises(OtherConfigurationError, match="it differs in"):
        create(path)
