"""What does a second worker bring? Whole commands, start-up included and apart, the two in turns.

python benchmarks/two_workers.py [--repeats 3] [--short] [--cases current-three exploring certificate …]

A case is a command in this process (`--serial`) and on two workers; `certificate` is one worker against two. Medians of
the turns are printed, and the median of the ratios within a turn: what disturbs the machine disturbs both. Processor
time is of the command and all its children; memory is the largest resident set of any one process of it.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from softclose_store import open_campaign

EXPLORING = ("campaign.budget=0", "population.n_switches=256", "explore.budget=1600", "explore.n_descents=6")
FEW = ("campaign.budget=12", "prior.budget=640", "prior.polish=88")
CERTIFIED = ("optimiser.engine=sobol", "campaign.budget=10", "population.n_switches=256", "store.n_times=11")


@dataclass(frozen=True)
class Took:
    """What one command took."""

    wall_s: float
    own_s: float
    """From the first wave to the last, start-up apart; NaN of a certificate."""
    cpu_s: float
    peak_MB: float


def command(*arguments: str) -> list[str]:
    """The command line of `softclose` under this interpreter."""
    return [sys.executable, "-m", "softclose_workflows", *arguments]


def sets(settings: tuple[str, ...]) -> list[str]:
    """Settings as options."""
    return [part for setting in settings for part in ("--set", setting)]


def measured(arguments: list[str], store: Path, *, runs: bool) -> Took:
    """Run a command to its end. runs: whether it is a campaign, which says in its store how long it was at work."""
    began = time.perf_counter()
    process = subprocess.Popen(command(*arguments), stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)  # with its children, which it has waited for
    wall = time.perf_counter() - began
    cpu, peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss
    while True:  # the process that workers are forked from is left behind, and ends by itself
        try:
            _, _, usage = os.wait4(-1, 0)
        except ChildProcessError:
            break
        cpu, peak = cpu + usage.ru_utime + usage.ru_stime, max(peak, usage.ru_maxrss)
    if status:
        raise SystemExit(f"{' '.join(arguments)} ended with {os.waitstatus_to_exitcode(status)}")
    spent = open_campaign(store).runtime["runs"][-1]["spent"] if runs else {}
    return Took(wall, spent.get("wall", float("nan")), cpu, peak / 1024)


def campaign(preset: str, settings: tuple[str, ...], where: tuple[str, ...], folder: Path) -> Took:
    """One run of a campaign."""
    store = folder / "a.zarr"
    arguments = ["run", preset, "--store", str(store), "--quiet", *where, *sets(settings)]
    return measured(arguments, store, runs=True)


def certificate(switches: int, where: tuple[str, ...], folder: Path) -> Took:
    """Certification of ten candidates of a campaign."""
    store = folder / "a.zarr"
    made = command("run", "current", "--store", str(store), "--quiet", "--serial", *sets(CERTIFIED))
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    arguments = ["certify", str(store), "--switches", str(switches), "--top", "10", "--quiet", *where]
    return measured(arguments, store, runs=False)


PR_SET_CHILD_SUBREAPER = 36
"""Of prctl(2): what descendants leave behind is handed to this process."""


def main() -> None:
    if sys.platform == "linux":  # elsewhere workers are not forked, and nothing is left behind
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    whole = ["current-three", "current-trim", "current-amplifier"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--short", action="store_true", help="a tenth of the work, to see that it runs")
    parser.add_argument("--cases", nargs="*", default=[*whole, "exploring", "certificate"])
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}; {options.repeats} turns")
    print(
        "| case | one, s | two, s | ratio | apart from start-up: one, s | two, s | ratio | processor time: one, s "
        "| two, s | largest process: one, MB | two, MB |\n| --- |" + " ---: |" * 10
    )
    for case in options.cases:
        arms: tuple[tuple[str, ...], tuple[str, ...]] = (("--serial",), ("--workers", "2"))
        if case == "certificate":
            arms = (("--workers", "1"), ("--workers", "2"))
        turns: list[list[Took]] = []
        for turn in range(options.repeats):
            found: dict[int, Took] = {}
            for arm in (0, 1) if turn % 2 == 0 else (1, 0):
                with tempfile.TemporaryDirectory() as name:
                    if case == "certificate":
                        found[arm] = certificate(20_000 if options.short else 1_000_000, arms[arm], Path(name))
                    elif case == "exploring":
                        few = ("explore.budget=160", "explore.n_scouts=8") if options.short else ()
                        found[arm] = campaign("current-three", (*EXPLORING, *few), arms[arm], Path(name))
                    else:
                        found[arm] = campaign(case, FEW if options.short else (), arms[arm], Path(name))
            turns.append([found[0], found[1]])
        print(row(case, turns), flush=True)


def row(case: str, turns: list[list[Took]]) -> str:
    """One line of the table."""
    cells = []
    for name, digits in (("wall_s", 1), ("own_s", 1), ("cpu_s", 1), ("peak_MB", 0)):
        both = [[getattr(took, name) for took in turn] for turn in turns]
        if name == "own_s" and case == "certificate":
            cells += ["–", "–", "–"]
            continue
        cells += [f"{statistics.median(values):,.{digits}f}" for values in zip(*both, strict=True)]
        if name in ("wall_s", "own_s"):
            cells.append(f"{statistics.median(one / two for one, two in both):.2f}")
    return f"| {case} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
