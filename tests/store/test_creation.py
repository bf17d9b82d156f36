"""Claims about layouts and the creation of stores."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr

import small_store
from small_store import CONFIG, create, layout, population
from softclose_store import (
    DriverStore,
    LayoutError,
    OtherConfigurationError,
    SchemaError,
    StoreError,
    StoreExistsError,
    StoreMissingError,
    create_campaign,
    fingerprint_of,
    open_campaign,
    store_state,
)


def test_a_new_store_opens_everywhere_with_no_candidate_and_no_warning(tmp_path):
    path = tmp_path / "new.zarr"
    create(path)
    assert xarray.open_zarr(path).sizes["candidate"] == 0
    assert zarr.open_group(path, mode="r")["x"].shape == (0, 10, 11)
    campaign = open_campaign(path)
    assert (campaign.committed, campaign.budget, campaign.finished) == (0, 4, False)
    assert campaign.best() is None
    assert len(campaign.history()) == 0
    assert campaign.config == CONFIG
    assert campaign.fingerprint == fingerprint_of(CONFIG)
    assert campaign.runtime["host"] == "here"


def test_a_chunk_that_cannot_be_cut_is_refused_with_advice():
    with pytest.raises(LayoutError, match=r"no divisor between 128 and 8192; use a multiple of 128, for example 10112"):
        layout(n_switches=50_000, chunk_switches=10_007)


def test_too_many_chunks_are_refused():
    with pytest.raises(LayoutError, match="at most 256 are allowed"):
        layout(n_switches=100_000, chunk_switches=10)


@pytest.mark.parametrize("field", ["n_candidates", "n_switches", "chunk_switches", "n_pulses"])
@pytest.mark.parametrize("value", [0, -1, 2.5, True, "3"])
def test_sizes_are_positive_integers(field, value):
    with pytest.raises(LayoutError, match=field):
        layout(**{field: value})


def test_times_must_increase():
    with pytest.raises(LayoutError, match="increasing"):
        layout(times_us=np.array([0.0, 2.0, 1.0]))


def test_the_population_must_fit(tmp_path):
    with pytest.raises(LayoutError, match="shape"):
        create_campaign(tmp_path / "a", layout=layout(), config=CONFIG, population=population(9))
    with pytest.raises(LayoutError, match="columns"):
        create_campaign(tmp_path / "a", layout=layout(), config=CONFIG, population={"D": np.ones(10)})
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
    with pytest.raises(StoreExistsError, match=r"0 of 4 candidates: continue it with `softclose resume"):
        create(path)
    create_campaign(path, layout=layout(), config=CONFIG, population=population(), exist_ok=True)
    small_store.run(path)
    with pytest.raises(StoreExistsError, match="finished"):
        create(path)


def test_another_configuration_is_refused_and_the_message_names_what_differs(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    changed = {"campaign": {"seed": 8, "budget": 4}, "model": {"horizon_us": 250.0, "restitution": 0.4}}
    with pytest.raises(OtherConfigurationError) as error:
        create(path, config=changed)
    assert "campaign.seed: the store has 7, this configuration 8" in str(error.value)
    assert "model.restitution: the store has nothing, this configuration 0.4" in str(error.value)
    assert "budget" not in str(error.value)
    with pytest.raises(OtherConfigurationError):
        DriverStore(path, expected_fingerprint=fingerprint_of(changed))


def test_a_fingerprint_that_is_not_the_configurations_is_refused(tmp_path):
    with pytest.raises(StoreError, match="fingerprint"):
        create_campaign(tmp_path / "a", layout=layout(), config=CONFIG, population=population(), fingerprint="00")


def test_a_newer_schema_version_is_refused_by_name(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    document = json.loads((path / "zarr.json").read_text())
    document["attributes"]["softclose_schema"] = 2
    (path / "zarr.json").write_text(json.dumps(document))
    for use in (open_campaign, DriverStore, store_state, lambda p: create(p)):
        with pytest.raises(SchemaError, match=r"schema version 2; this version of softclose reads up to 1"):
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


def test_an_unfinished_creation_at_the_path_itself_is_recognised(tmp_path):
    create(tmp_path / "a.zarr")
    (tmp_path / "a.zarr" / "zarr.json").unlink()  # what an interrupted copy leaves behind
    assert store_state(tmp_path / "a.zarr").kind == "unfinished"
    with pytest.raises(StoreMissingError, match="unfinished creation"):
        open_campaign(tmp_path / "a.zarr")


def test_the_store_of_a_url_is_like_a_local_one():
    url = "memory://test-creation/a.zarr"
    assert store_state(url).kind == "absent"
    create(url)
    with pytest.raises(StoreExistsError):
        create(url)
    small_store.run(url)
    best = open_campaign(url).best()
    assert best is not None
    assert best.candidate == 1
    assert xarray.open_zarr(url).sizes["candidate"] == 4


def test_files_per_candidate_do_not_depend_on_the_number_of_switches(tmp_path):
    counts = []
    for n in (1024, 4096):
        sizes = create(tmp_path / str(n), n_switches=n, chunk_switches=n // 4)
        with DriverStore(tmp_path / str(n)) as store:
            small_store.run_candidate(store, 0, n)
        counts.append(sum(1 for p in Path(tmp_path / str(n)).rglob("*") if p.is_file()))
        assert sizes.n_chunks == 4
    assert counts[0] == counts[1]
