"""Claims about work too large for a machine: it is refused in one message, before anything is allocated or created."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from campaigns import command, run_arguments
from small_campaigns import FINISHED
from softclose.settings import load_config
from softclose_workflows.cli import main
from softclose_workflows.run import block_memory, needs
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.executors.placement import n_cores

GB = 1e9


MACHINE_MEMORY = needs.machine_memory_bytes


@pytest.fixture(autouse=True)
def small_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """8 GB of memory: what is refused here does not depend on where the tests run."""
    monkeypatch.setattr(needs, "machine_memory_bytes", lambda: 8 * GB)


def softclose(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def refused(done: Result, *words: str) -> None:
    assert done.exit_code == 2, (done.output, done.exception)
    assert len(done.output.splitlines()) == 1, done.output
    for word in words:
        assert word in done.output


@pytest.mark.parametrize(
    "setting",
    [
        "population.n_switches=100000000000",
        "population.n_switches=1000000000000",
        "population.n_switches=1e12",
        "campaign.budget=1000000000000",
        "campaign.budget=1e12",
        "campaign.lag=1000000000000",
        "finish.budget=1000000000000",
        "optimiser.n_candidates=1000000000000",
        "model.horizon_us=1e12",
        "model.horizon_us=1",
        "model.plate_area_um2=1e300",
        "model.plate_area_um2=1e-9",
        "waveform.max_volts=1e300",
        "waveform.max_volts=1e9",
        "waveform.max_volts=1e-3",
        "waveform.min_rise_us=1e5",
        "objective.c1_cm_s=1e300",
        "objective.undefined_v_u_cm_s=1e300",
    ],
)
def test_a_setting_that_no_machine_or_switch_could_follow_is_refused(tmp_path: Path, setting: str) -> None:
    store = tmp_path / "a.zarr"
    refused(softclose("run", "current", "--store", str(store), "--serial", "--set", setting), setting.split("=")[0])
    assert not store.exists()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("population.n_switches=100000000",), ("100,000,000 switches", "memory", "of disk", "n_switches")),
        (("campaign.budget=1000000", "population.n_switches=1000000"), ("1,000,800 candidates", "of disk", "budget")),
    ],
)
def test_a_campaign_that_does_not_fit_is_refused_before_its_store_exists(
    tmp_path: Path, settings: tuple[str, ...], words: tuple[str, ...]
) -> None:
    store = tmp_path / "new" / "a.zarr"
    sets = [part for s in (*settings, "finish.budget=800") for part in ("--set", s)]
    refused(softclose("run", "current", "--store", str(store), "--workers", "1", *sets), *words)
    assert not store.parent.exists()


def test_a_larger_campaign_at_the_place_of_another_is_refused_too(finished_store: Path) -> None:
    done = softclose("run", "current", "--store", str(finished_store), "--set", "population.n_switches=100000000")
    refused(done, "memory")


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("certify", "{store}", "--switches", "100000000000"), "--switches"),
        (("tolerance", "{store}", "--switches", "100000000000"), "--switches"),
        (("sensitivity", "{store}", "--points", "1099511627776"), "--points"),
        (("compare-engines", "current", "--engines", "sobol", "--switches", "100000000000"), "--switches"),
        (
            ("compare-engines", "current", "--engines", "sobol", "--set", "population.n_switches=100000000"),
            "population.n_switches",
        ),
        (("study", "c1", "--out", "{new}", "--switches", "100000000000"), "--switches"),
        (("study", "c1", "--out", "{new}", "--set", "population.n_switches=100000000"), "population.n_switches"),
        (("reproduce", "--out", "{new}", "--switches", "100000000000"), "--switches"),
        (("reproduce", "--out", "{new}", "--set", "store.n_times=100001"), "store.n_times"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_too_many_switches_are_refused_before_any_is_drawn(
    tmp_path: Path, finished_store: Path, arguments: tuple[str, ...], option: str
) -> None:
    new = tmp_path / "new"
    done = softclose(*(a.format(store=finished_store, new=new) for a in arguments))
    refused(done, "would take at least", option)
    assert not new.exists()
    assert not (finished_store / "certification").exists()


def test_the_estimate_of_the_disk_is_of_the_size_of_a_real_store(finished_store: Path) -> None:
    config = load_config("current", (*FINISHED, "finish.budget=0"))
    written = sum(p.stat().st_size for p in finished_store.rglob("*") if p.is_file())
    needed = needs.of_run(config, workers=1).disk_bytes
    assert needed < written < 4.0 * needed


def test_a_campaign_says_what_it_will_write_and_where_it_is_much_what_makes_it_less() -> None:
    small = load_config("current", (*FINISHED, "finish.budget=0"))
    said = needs.announced(small)
    assert re.fullmatch(r"the store will take about [0-9.]+ [kM]B", said)
    large = load_config("current", ["explore.budget=50000", "store.n_times=1001"])
    said = needs.announced(large)
    assert re.match(r"the store will take about [0-9.]+ GB, 9\d % of it x\(t\) and v\(t\)", said)
    assert "store.n_times=1001" in said
    assert needs.of_run(load_config("current", ["explore.budget=50000", "store.n_times=11"]), workers=0).disk_bytes < (
        0.1 * needs.of_run(large, workers=0).disk_bytes
    )


def test_what_is_committed_needs_no_further_disk() -> None:
    config = load_config("current")
    whole = needs.of_run(config, workers=1)
    half = needs.of_run(config, workers=1, committed=config.total_budget // 2)
    assert half.disk_bytes == pytest.approx(whole.disk_bytes / 2, rel=1e-3)
    assert half.memory_bytes == whole.memory_bytes
    assert needs.of_run(config, workers=1, committed=config.total_budget).disk_bytes == 0.0


def test_more_workers_need_more_memory_and_those_of_a_scheduler_none_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config("current", ["population.n_switches=1000000"])
    one = needs.of_run(config, workers=1).memory_bytes
    monkeypatch.setattr(needs, "machine_memory_bytes", lambda: 1.5 * one)
    needs.check_run(config, Placement(workers=1), "https://somewhere/a.zarr")
    needs.check_run(config, Placement(scheduler="tcp://elsewhere:8786"), "https://somewhere/a.zarr")
    with pytest.raises(needs.NeedsError, match="fewer workers"):
        needs.check_run(config, Placement(workers=4), "https://somewhere/a.zarr")


def test_the_disk_that_counts_is_the_one_of_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    usage = shutil.disk_usage

    def disk_usage(path: Path) -> tuple[int, int, int]:
        asked.append(path)
        return usage(path)

    monkeypatch.setattr(needs.shutil, "disk_usage", disk_usage)
    needs.check_run(load_config("current"), Placement(serial=True), str(tmp_path / "not" / "yet.zarr"))
    assert asked == [tmp_path]


def test_the_memory_of_a_container_counts_where_it_is_less(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {"/proc/self/cgroup": "0::/job\n", "/sys/fs/cgroup/job/memory.max": "1000000000\n"}
    monkeypatch.setattr(needs.Path, "read_text", lambda self, encoding: files[str(self)])
    assert MACHINE_MEMORY() == GB
    files["/sys/fs/cgroup/job/memory.max"] = "max\n"
    assert MACHINE_MEMORY() > GB


def test_cores_are_counted_where_a_system_has_no_affinities(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert n_cores() == 7
    assert Placement().n_processes == 7


def test_a_limit_of_address_space_is_found_out_before_a_library_spins_in_it(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    program = f"ulimit -v 1000000; exec {shlex.join(command(*run_arguments(store)))} --serial"
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert "of address space, of which a process may have 1.02 GB (ulimit -v)" in done.stderr
    assert not store.exists()


def test_a_block_that_a_worker_cannot_hold_is_named_with_the_one_that_fits() -> None:
    config = load_config("current", ["population.n_switches=100000", "compute.block_switches=100000"])
    needed = block_memory.of_worker(config)
    assert block_memory.too_large_for(config, needed) == ""
    said = block_memory.too_large_for(config, 0.5 * needed)
    found = re.search(r"a block of 100,000 trajectories takes .* compute\.block_switches=(\d+) fits", said)
    assert found is not None
    fits = int(found[1])
    smaller = load_config("current", ["population.n_switches=100000", f"compute.block_switches={fits}"])
    larger = load_config("current", ["population.n_switches=100000", f"compute.block_switches={fits + 1}"])
    assert block_memory.of_worker(smaller) <= 0.5 * needed < block_memory.of_worker(larger)
    assert "give workers more memory" in block_memory.too_large_for(config, 1e6)
    assert "has 0 MB left" in block_memory.too_large_for(config, -1e6)


def test_temporary_files_that_do_not_fit_are_refused_with_the_folder_that_they_would_fill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(needs.shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(0, 0, 3e8))
    needs.check_fresh(800_000, 12)
    with pytest.raises(needs.NeedsError, match=rf"360 MB of temporary files, of which 300 MB are free at {tmp_path}"):
        needs.check_fresh(1_000_000, 12)
    twice = needs.of_all([needs.of_fresh(800_000, 12), needs.of_fresh(700_000, 12)])
    assert twice.scratch_bytes == needs.of_fresh(800_000, 12).scratch_bytes, "one after the other"
