"""Scores the tests of the modules where a silent error costs most: how many small changes of meaning do they notice?

`make mutants` samples mutants of every module of `mutants.toml`, runs that module's tests against each and writes
docs/measurements/mutants.md. `python -m mutants objective pwl` does some modules only; the others keep their row.
The tests run in a copy of the tree, in a child forked from a process that has imported the libraries already: most of
the time of a short test file is numpy's, numba's and xarray's own.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from mutation import Mutant, mutants

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).with_suffix(".toml")
RESULTS = ROOT / "docs" / "measurements" / "mutants.json"
PAGE = RESULTS.with_suffix(".md")
DATED = "29 November 2026"
"""Since when a score says when it was made."""
COPIED = ("pipeline", "store", "workflows", "tests", "pyproject.toml", "README.md", "docs", "scripts", "benchmarks")
SOURCES = ("pipeline", "store", "workflows")
MEMORY_BYTES = 8 * 2**30
"""Address space of a test run."""
PLUGINS = ("pytest_timeout", "_hypothesis_pytestplugin")
LIBRARIES = (
    *PLUGINS,
    *(
        "scipy.stats",
        "scipy.optimize",
        "scipy.integrate",
        "numba",
        "pandas",
        "xarray",
        "zarr",
        "pydantic",
        "rich.table",
    ),
    *("hypothesis.strategies", "hypothesis.internal.conjecture.engine", "hypothesis.internal.entropy", "pytest"),
)
"""Imported once, before the forks; the project itself is imported by every child, from its copy."""


@dataclass(frozen=True)
class Target:
    """A module and the tests that answer for it."""

    module: str
    """Path from the root."""
    tests: tuple[str, ...]
    """Arguments of pytest."""
    no_jit: bool
    """Run kernels as plain Python."""


@dataclass(frozen=True)
class Outcome:
    """What became of one mutant."""

    line: int
    before: str
    after: str
    killed: bool


@dataclass(frozen=True)
class Score:
    """What became of the mutants of one module."""

    module: str
    places: int
    """Places where it can be mutated."""
    outcomes: tuple[Outcome, ...]
    seconds: float
    """Time of the whole sample, one mutant at a time."""


@dataclass(frozen=True)
class Limits:
    """How long a test run may take, in seconds.

    On a busy machine the clock goes on while the tests wait, and a mutant that is merely late would count as killed:
    an endless loop is ended by the processor's time, a wait without end by the clock.
    """

    processor: int
    clock: float


BASELINE = Limits(processor=600, clock=1800.0)


def run_tests(copy: Path, target: Target, limits: Limits) -> tuple[int, float]:
    """Exit status of the tests in a copy of the tree (124 past the clock's limit) and their processor time in s."""
    pid = os.fork()
    if pid == 0:
        _run_in_child(copy, target, limits)
    deadline = time.monotonic() + limits.clock
    while time.monotonic() < deadline:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # the tests' own children too
    os.waitpid(pid, 0)
    return 124, limits.clock


def _run_in_child(copy: Path, target: Target, limits: Limits) -> None:
    status = 70
    try:
        os.setsid()
        os.chdir(copy)
        resource.setrlimit(resource.RLIMIT_CPU, (limits.processor, limits.processor))
        # A mutant may ask for all memory there is, and the system would end somebody else's process for it.
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        log = os.open(copy / "tests.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(log, stream)
        # Two versions of a module within one second and of one size: Python would take the older's bytecode.
        sys.dont_write_bytecode = True
        sources = [str(copy / source) for source in SOURCES]
        sys.path[:0] = sources
        os.environ |= {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": os.pathsep.join(sources)}
        os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        if target.no_jit:
            import numba

            os.environ["NUMBA_DISABLE_JIT"] = "1"
            numba.config.DISABLE_JIT = True
        import pytest

        options = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", f"--rootdir={copy}"]
        # pytest would rewrite the assertions of plugins, had they not been imported before the fork.
        options += ["-W", "ignore::pytest.PytestAssertRewriteWarning", *(f"-p{plugin}" for plugin in PLUGINS)]
        status = int(pytest.main([*options, *target.tests]))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


@contextlib.contextmanager
def copies(n: int) -> Iterator[SimpleQueue[Path]]:
    """n copies of the working tree, free to be taken."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        free: SimpleQueue[Path] = SimpleQueue()
        for i in range(n):
            copy = Path(folder) / str(i)
            copy.mkdir()
            for name in COPIED:
                if (ROOT / name).is_dir():
                    # Compiled kernels come along (numba looks at the time and size of their source).
                    ignored = shutil.ignore_patterns("*.pyc", "_build", ".hypothesis")
                    shutil.copytree(ROOT / name, copy / name, ignore=ignored)
                else:
                    shutil.copy2(ROOT / name, copy / name)
            free.put(copy)
        yield free


def score(
    target: Target, free: SimpleQueue[Path], jobs: int, n: int, seed: int, known: dict[tuple[str, str], bool]
) -> Score:
    """Run the sample of one module, but for mutants known to be killed. Raises SystemExit where it fails unchanged."""
    held = [free.get() for _ in range(jobs)]
    source = (held[0] / target.module).read_text("utf-8")
    sample, places = mutants(source, n, seed)
    slowest_s = slowest_cpu_s = 0.0
    for copy in held:  # also fills each copy's cache of compiled kernels
        begin = time.monotonic()
        status, cpu_s = run_tests(copy, target, BASELINE)
        slowest_s = max(slowest_s, time.monotonic() - begin)
        slowest_cpu_s = max(slowest_cpu_s, cpu_s)
        if status != 0:
            log = (copy / "tests.log").read_text("utf-8")
            raise SystemExit(f"{target.module}: its tests end with {status} before anything is changed\n{log[-3000:]}")
        free.put(copy)
    limits = Limits(processor=10 + round(4.0 * slowest_cpu_s), clock=60.0 + 10.0 * slowest_s)

    def attempt(mutant: Mutant) -> tuple[Outcome, float]:
        if known.get((mutant.before, mutant.after)):
            return Outcome(line=mutant.line, before=mutant.before, after=mutant.after, killed=True), 0.0
        copy = free.get()
        try:
            file = copy / target.module
            stamp = file.stat()
            file.write_text(mutant.source, "utf-8")
            begin = time.monotonic()
            status, _ = run_tests(copy, target, limits)
            seconds = time.monotonic() - begin
            file.write_text(source, "utf-8")
            os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
        finally:
            free.put(copy)
        return Outcome(line=mutant.line, before=mutant.before, after=mutant.after, killed=status != 0), seconds

    with ThreadPoolExecutor(jobs) as pool:
        done = list(pool.map(attempt, sample))
    return Score(target.module, places, tuple(o for o, _ in done), sum(s for _, s in done))


def page(table: dict[str, Any], scores: dict[str, dict[str, Any]]) -> str:
    """The page of the documentation."""
    lines = [
        "# How much the tests notice",
        "",
        "`make mutants` changes one thing at a time in the modules where a silent error costs most (a sign, a bound,",
        "an argument left out) and runs the tests that answer for the module. A change that no test notices survives.",
        f"The sample is {table['sample']} places a module, or all there are, by a fixed seed. A survivor whose",
        "program does the same as the original, or differs in nothing that a test should claim, is named below with",
        "the reason and does not count. The first score is that of the tests before their survivors were looked at.",
        "It takes hours: it is run before a release, and for a module whose tests change. The last column says when",
        f"and on which commit a module was scored last; a row without it is older than {DATED}.",
        "",
        "| module | places | tried | killed | equivalent | survive | score | first | last run |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
    ]
    details: list[str] = []
    for module, entry in table["modules"].items():
        name = f"`{module.split('/', 1)[1]}`"
        if module not in scores:
            lines.append(f"| {name} | | | | | | not scored yet | | |")
            continue
        outcomes = scores[module]["outcomes"]
        same = {(e["before"], e["after"]): e["why"] for e in entry.get("equivalent", ())}
        killed = sum(o["killed"] for o in outcomes)
        excused = [o for o in outcomes if not o["killed"] and (o["before"], o["after"]) in same]
        alive = [o for o in outcomes if not o["killed"] and (o["before"], o["after"]) not in same]
        counting = len(outcomes) - len(excused)
        rate = f"{killed / counting:.0%}" if counting else "nothing to change"
        counts = f"{scores[module]['places']} | {len(outcomes)} | {killed} | {len(excused)} | {len(alive)}"
        when = " ".join(scores[module].get(key, "") for key in ("date", "commit")).strip()
        lines.append(f"| {name} | {counts} | {rate} | {scores[module]['first']} | {when} |")
        if excused or alive:
            details += ["", f"## {name}", ""]
            for o in alive:
                details.append(f"* survives: `{o['before']}` → `{o['after']}`")
            for o in excused:
                details.append(f"* equivalent: `{o['before']}` → `{o['after']}`. {same[o['before'], o['after']]}")
    return "\n".join([*lines, *details]) + "\n"


def stamp() -> dict[str, str]:
    """Today, and the commit that is scored; a + where the tree differs from it."""
    words = ["git", "-C", str(ROOT), "describe", "--always", "--abbrev=9", "--dirty=+", "--exclude=*"]
    commit = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return {"date": time.strftime("%Y-%m-%d", time.gmtime()), "commit": commit}


def main() -> None:
    """Score some or all modules and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="words in the paths of modules; all modules where left out")
    parser.add_argument("--jobs", type=int, default=2, help="copies of the tree, each with one test run at a time")
    parser.add_argument("--survivors", action="store_true", help="only mutants that survived last time, and new ones")
    options = parser.parse_args()
    table = tomllib.loads(TABLE.read_text("utf-8"))
    scores = {s["module"]: s for s in json.loads(RESULTS.read_text("utf-8"))} if RESULTS.exists() else {}
    for library in LIBRARIES:
        importlib.import_module(library)
    with copies(options.jobs) as free:
        for module, entry in table["modules"].items():
            if options.names and not any(name in module for name in options.names):
                continue
            target = Target(module, tuple(entry["tests"]), entry.get("no_jit", False))
            last = scores.get(module, {"outcomes": []})
            known: dict[tuple[str, str], bool] = {}
            for o in last["outcomes"] if options.survivors else ():
                text = o["before"], o["after"]
                known[text] = known.get(text, True) and o["killed"]  # two lines may read the same
            result = score(target, free, options.jobs, table["sample"], table["seed"], known)
            killed = sum(o.killed for o in result.outcomes)
            first = last.get("first", f"{killed} of {len(result.outcomes)}")
            scores[module] = asdict(result) | stamp() | {"first": first}
            print(f"{module}: {killed} of {len(result.outcomes)} killed in {result.seconds:.0f} s", flush=True)
            for o in result.outcomes:
                if not o.killed:
                    print(f"  {o.line}: {o.before}\n    -> {o.after}", flush=True)
            _write(table, scores)
    _write(table, scores)


def _write(table: dict[str, Any], scores: dict[str, dict[str, Any]]) -> None:
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    kept = [scores[m] for m in table["modules"] if m in scores]
    RESULTS.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", "utf-8")
    PAGE.write_text(page(table, scores), "utf-8")


if __name__ == "__main__":
    main()
