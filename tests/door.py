"""Damages one file of a store in every way, asks every command, and says what came out that should not have.

What is asked of a command on a store of which one file is lost, cut, foreign, or no file at all: it refuses, in one
line that names the file and `softclose verify STORE --repair` (exit 1), or it answers as from the whole store. Never
another number, a traceback, or a touch of anything outside.
"""

from __future__ import annotations

import os
import resource
import shutil
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from click.testing import CliRunner, Result

from small_campaigns import COARSE, COMPLETE, finish, make_campaign, make_complete
from softclose_store import open_campaign
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.cli import main
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.extension import extend
from stores import files_of

MOST_BYTES, MOST_SECONDS = 500_000_000, 20.0

OPENING = (
    *COARSE,
    "model.quality_factor=20",
    "opening.release_us=300",
    "opening.brake=12",
    "opening.n_switches=60",
    "opening.watch_us=50",
)
FRONT = (
    "campaign.budget=12",
    "optimiser.n_initial=4",
    "optimiser.batch=4",
    "population.n_switches=32",
    "store.n_times=11",
    "store.max_impacts=3",
)


def _plain(path: Path) -> None:
    make_campaign(path, *COMPLETE)


def _trimmed(path: Path) -> None:
    make_campaign(path, *COMPLETE, preset="current-trim")


def _opening(path: Path) -> None:
    make_campaign(path, *OPENING, run=False)
    finish(path)
    drive(str(path), Placement(serial=True), quiet=True)


def _certified(path: Path) -> None:
    make_complete(path)


def _raced(path: Path) -> None:
    make_campaign(path, *COARSE, run=False)
    finish(path)
    certify_within(str(path), 5.0, n_switches=400, top=3)


def _halfway(path: Path) -> None:
    make_campaign(path, *COMPLETE, run=False, preset="current-trim")
    finish(path, blocks=14)


def _extended(path: Path) -> None:
    make_campaign(path, *COMPLETE, "explore.budget=0", "finish.budget=0", "campaign.budget=7")
    extend(str(path), 11)
    finish(path)


def _front(path: Path) -> None:
    make_campaign(path, *FRONT, run=False, preset="current-front")
    finish(path)


SORTS: dict[str, Callable[[Path], None]] = {
    "plain": _plain,
    "trimmed": _trimmed,
    "opening": _opening,
    "certified": _certified,
    "raced": _raced,
    "extended": _extended,
    "front": _front,
    "halfway": _halfway,
}
"""How a small store of each sort is made."""

KINDS = {
    "root": "zarr.json",
    "copy of the root": "digests/root.json",
    "runtime": "runtime/zarr.json",
    "stage": "{stage}/zarr.json",
    "array": "records/zarr.json",
    "population": "K/c.0",
    "scales": "voltage_scale/c.0",
    "instants": "{stage}/time/c.0",
    "records": "records/c.0.0",
    "words": "words/c.0.0",
    "timings": "wall_times/c.0.0",
    "digest": "digests/c.0.0",
    "response": "{stage}/response/c.0.0.0",
    "impacts": "{stage}/impact/c.0.0.0.0",
    "motion": "{stage}/x/c.0.0.0",
    "marker": "{stage}/block_digest/c.0.0.0",
    "certificate": "{certificate}/max_contact_speed/c/0/0",
    "metadata of a certificate": "{certificate}/zarr.json",
    "copy of them": "{certificate}/candidate/group.json",
    "certificates": "certification/zarr.json",
    "opening": "{opening}/release_overshoot/c/0/0",
    "metadata of an opening": "{opening}/zarr.json",
}
"""A file of each kind."""

SIBLINGS = {"K/c.0": "M/c.0", "voltage_scale/c.0": "time_scale/c.0", "zarr.json": "digests/root.json"}


def lost(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()


def emptied(file: Path, sibling: Path, outside: Path) -> None:
    file.write_bytes(b"")


def cut(file: Path, sibling: Path, outside: Path) -> None:
    file.write_bytes(file.read_bytes()[:-3])


def flipped(file: Path, sibling: Path, outside: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


def swapped(file: Path, sibling: Path, outside: Path) -> None:
    mine, other = file.read_bytes(), sibling.read_bytes()
    file.write_bytes(other)
    sibling.write_bytes(mine)


def foreign(file: Path, sibling: Path, outside: Path) -> None:
    file.write_bytes(sibling.read_bytes())


def folder(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    file.mkdir()
    (file / "notes.txt").write_text("mine")


def empty_folder(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    file.mkdir()


def link_inside(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    file.symlink_to(sibling)


def link_outside(file: Path, sibling: Path, outside: Path) -> None:
    (outside / "file").write_bytes(file.read_bytes())
    file.unlink()
    file.symlink_to(outside / "file")


def link_loop(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    file.symlink_to(file.name)


def endless(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def pipe(file: Path, sibling: Path, outside: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def linked_folder(file: Path, sibling: Path, outside: Path) -> None:
    if (file.parent / "digests").is_dir():  # the store's own folder is the user's
        emptied(file, sibling, outside)
        return
    shutil.copytree(file.parent, outside / "folder")
    shutil.rmtree(file.parent)
    file.parent.symlink_to(outside / "folder")


DAMAGES = {
    damage.__name__: damage
    for damage in (
        *(lost, emptied, cut, flipped, swapped, foreign, folder, empty_folder),
        *(link_inside, link_outside, link_loop, endless, pipe, linked_folder),
    )
}
"""What is done to it: (the file, another one of its kind, a folder outside)."""

READING: dict[str, tuple[str, ...]] = {
    "status": ("status", "{store}"),
    "status as JSON": ("status", "{store}", "--json"),
    "export history": ("export", "{store}", "history"),
    "export ensemble": ("export", "{store}", "ensemble", "--format", "netcdf", "--trajectories", "-o", "{out}/a.nc"),
    "export waveform": ("export", "{store}", "waveform", "--rate", "5"),
    "rescore": ("rescore", "{store}", "--level", "0.9", "--json"),
    "pareto": ("pareto", "{store}", "--json"),
    "tails": ("tails", "{store}", "--method", "brute", "--switches", "200", "--json"),
    "compare": ("compare", "{store}", "{store}", "--json", "-o", "{out}/compare.html"),
    "report": ("report", "{store}", "-o", "{out}/report.html"),
}
"""Commands that read."""

WRITING: dict[str, tuple[str, ...]] = {
    "resume": ("resume", "{store}", "--serial", "--quiet"),
    "extend": ("resume", "{store}", "--budget", "{more}", "--serial", "--quiet"),
    "certify": ("certify", "{store}", "--switches", "100", "--top", "2", "--threads", "1", "--json"),
}
"""Commands that write."""


ONLY = {"halfway": ("status", "export ensemble", "rescore", "resume")}
"""Commands where not all can be asked: a campaign that was killed can be neither extended nor certified."""


@dataclass
class Case:
    """A whole store, and what the commands say of it."""

    sort: str
    whole: Path
    """Never changed."""
    path: Path
    """Where damaged copies of it lie: answers name the path."""
    answers: dict[str, Result] = field(default_factory=dict)
    results: dict[str, dict[str, bytes]] = field(default_factory=dict)
    """What a writing command leaves of the whole store."""

    @property
    def commands(self) -> dict[str, tuple[str, ...]]:
        """What is asked of this store."""
        every = READING | WRITING
        return {name: every[name] for name in ONLY.get(self.sort, every)}

    @cached_property
    def kinds(self) -> dict[str, str]:
        """The kinds of files that this store has: kind -> file."""
        campaign = open_campaign(self.whole)
        have = {f.relative_to(self.whole).as_posix() for f in files_of(self.whole)}

        def first(prefix: str) -> str:
            groups = sorted(
                {"/".join(key.split("/")[:2]) for key in have if key.startswith(prefix)} - {prefix + "zarr.json"}
            )
            return groups[0] if groups else "none"

        names = {
            "stage": next(iter(campaign.stages)),
            "certificate": first("certification/"),
            "opening": first("opening/"),
        }
        found = {kind: key.format(**names) for kind, key in KINDS.items()}
        return {kind: key for kind, key in found.items() if key in have}

    def sibling(self, key: str) -> str:
        """Another file of the same kind."""
        if key in SIBLINGS:
            return SIBLINGS[key]
        last = key.rpartition("/")[2]
        have = sorted(f.relative_to(self.whole).as_posix() for f in files_of(self.whole))
        alike = [k for k in have if k != key and k.rpartition("/")[2] == last]
        near = [
            k for k in have if k != key and k.rpartition("/")[0] == key.rpartition("/")[0] and not k.endswith(".json")
        ]
        return (near or alike or [k for k in have if k != key and k.endswith(".json")])[0]


def make_cases(folder: Path, sorts: Iterable[str] | None = None) -> dict[str, Case]:
    """A store of each sort."""
    cases = {}
    for sort in sorts or SORTS:
        whole = folder / "whole" / f"{sort}.zarr"
        whole.parent.mkdir(exist_ok=True)
        SORTS[sort](whole)
        cases[sort] = Case(sort, whole, folder / f"{sort}.zarr")
    return cases


def contents(path: Path) -> dict[str, bytes]:
    """Key -> bytes of every file below a folder, links as what they say."""
    found = {}
    for folder, folders, names in os.walk(path):
        for name in (*names, *folders):
            file = Path(folder, name)
            if file.is_symlink():
                found[file.relative_to(path).as_posix()] = b"-> " + os.fsencode(os.readlink(file))
            elif file.is_file():
                found[file.relative_to(path).as_posix()] = file.read_bytes()
            elif not file.is_dir():
                found[file.relative_to(path).as_posix()] = b"special"
    return found


def fresh(case: Case) -> Path:
    """A new copy of the whole store at its place."""
    for place in (case.path, Path(f"{case.path}.strays")):
        shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(case.whole, case.path)
    return case.path


def ask(case: Case, command: tuple[str, ...], out: Path) -> Result:
    """What a command says of the store at the case's place."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    more = str(open_campaign(case.whole).budget + 4)
    return CliRunner().invoke(main, [part.format(store=case.path, out=out, more=more) for part in command])


def run_case(
    case: Case, kind: str, damage: str, commands: dict[str, tuple[str, ...]], *, repair: bool = True
) -> list[str]:
    """Everything that is wrong about the answers to one damage."""
    key = case.kinds[kind]
    out, outside = case.path.parent / "out", case.path.parent / "outside"  # answers name where they were written
    wrong = []

    def asked(name: str, command: tuple[str, ...], check: Callable[[Answer], str]) -> None:
        before = contents(outside)
        problem = check(ask_timed(case, command, out))
        if contents(outside) != before:
            problem = "touched what lies outside"
        if problem:
            wrong.append(f"{case.sort}, {kind} {damage}, {name}: {problem}")

    for name, command in commands.items():
        if name not in case.answers:
            fresh(case)
            case.answers[name] = ask(case, command, out)
            assert case.answers[name].exit_code == 0, case.answers[name].output
            case.results[name] = contents(case.path)
    _damaged(case, key, damage, outside)
    told = contents(case.path)
    for name in sorted(commands.keys() & READING.keys()):
        asked(name, commands[name], lambda answer, name=name: _answer(case, name, answer, key, told))
    assert contents(case.path) == told, f"{kind} {damage}: a command that reads has written"
    if repair:
        asked("repair", ("verify", "{store}", "--repair"), lambda answer: _repaired(case, answer))
    for name in sorted(commands.keys() & WRITING.keys()):
        _damaged(case, key, damage, outside)
        asked(name, commands[name], lambda answer, name=name: _answer(case, name, answer, key, told))
    return wrong


def _damaged(case: Case, key: str, damage: str, outside: Path) -> None:
    path = fresh(case)
    shutil.rmtree(outside, ignore_errors=True)
    outside.mkdir()
    DAMAGES[damage](path / key, path / case.sibling(key), outside)


Answer = tuple[Result, float, int]
"""What a command said, and the seconds and bytes that it took."""


def ask_timed(case: Case, command: tuple[str, ...], out: Path) -> Answer:
    """The answer, and the seconds and bytes that it took."""
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    result = ask(case, command, out)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return result, time.monotonic() - began, grown * 1024


def _unfit(answer: Answer) -> str:
    result, seconds, grown = answer
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return f"raised {type(result.exception).__name__}: {result.exception}"
    if seconds > MOST_SECONDS or grown > MOST_BYTES:
        return f"took {seconds:.1f} s and {grown:,} bytes"
    return ""


def _answer(case: Case, name: str, answer: Answer, key: str, told: dict[str, bytes]) -> str:
    result, whole = answer[0], case.answers[name]
    if problem := _unfit(answer):
        return problem
    if result.exit_code == 0:
        if name in WRITING:
            now = {k: v for k, v in contents(case.path).items() if k not in told or told[k] != v}
            other = [k for k, v in now.items() if case.results[name].get(k) != v and not _may_differ(k)]
            if other:
                return f"wrote {other[:3]} otherwise"
        return "" if result.output == whole.output else f"said {_first_difference(whole.output, result.output)}"
    text = result.output
    named = any(name in text for name in (key, key.rpartition("/")[0] or key, case.sibling(key)))
    if result.exit_code != 1 or not named or "softclose verify" not in text or "--repair" not in text:
        return f"exit {result.exit_code}: {text[-400:]}"
    return ""


def _first_difference(a: str, b: str) -> str:
    for left, right in zip(a.splitlines(), b.splitlines(), strict=False):
        if left != right:
            return f"{right!r} instead of {left!r}"
    return f"{b[-200:]!r} instead of {a[-200:]!r}"


def _may_differ(key: str) -> bool:
    return key in ("zarr.json", "runtime/zarr.json", "digests/root.json") or key.startswith("wall_times/")


def _repaired(case: Case, answer: Answer) -> str:
    result = answer[0]
    if problem := _unfit(answer):
        return problem
    now, was = contents(case.path), contents(case.whole)
    different = sorted(k for k in now.keys() | was.keys() if now.get(k) != was.get(k) and not k.endswith("driver.lock"))
    if result.exit_code == 0:
        bad = [
            k
            for k in different
            if not (k.startswith("wall_times/") and "timings" in result.output)
            and not (k in ("zarr.json", "runtime/zarr.json") and "who ran" in result.output)
        ]
        return f"left {bad[:4]} otherwise: {result.output[-600:]}" if bad else ""
    return f"exit {result.exit_code}: {result.output[-600:]}"
