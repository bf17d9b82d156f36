"""Damages one file of a store in every way, asks every command, and says what came out that should not have.

A command that looks at nothing that a damage has changed, neither at the file nor at names in its folder, does what it
does with the whole store: it is not asked, but for one in twenty. `Case.spared` counts them.

What is asked of a command on a store of which one file is lost, cut, foreign, or no file at all: it refuses, in one
line that names the file and `softclose verify STORE --repair` (exit 1), or it answers as from the whole store. Never
another number, a traceback, or a touch of anything outside.
"""

from __future__ import annotations

import os
import resource
import shutil
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from unittest.mock import patch

from click.testing import CliRunner, Result

from small_campaigns import COARSE, COMPLETE, finish, make_campaign, make_complete
from softclose_store import open_campaign
from softclose_store.disk.below import Below
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
    "prior.model=none",
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
    "copy of the root": "candidates/digests/root.json",
    "runtime": "runtime/zarr.json",
    "stage": "{stage}/zarr.json",
    "array": "candidates/records/zarr.json",
    "population": "population/K/c.0",
    "scales": "population/voltage_scale/c.0",
    "instants": "{stage}/time/c.0",
    "records": "candidates/records/c.0.0",
    "words": "candidates/words/c.0.0",
    "timings": "candidates/wall_times/c.0.0",
    "digest": "candidates/digests/c.0.0",
    "response": "{stage}/response/c.0.0.0",
    "impacts": "{stage}/impact/c.0.0.0.0",
    "motion": "{stage}/x/c.0.0.0",
    "marker": "{stage}/block_digest/c.0.0.0",
    "certificate": "{certificate}/max_contact_speed/c/0/0",
    "metadata of a certificate": "{certificate}/zarr.json",
    "copy of them": "{certificate}/D/group.json",
    "certificates": "certification/zarr.json",
    "opening": "{opening}/release_overshoot/c/0/0",
    "metadata of an opening": "{opening}/zarr.json",
}
"""A file of each kind."""

SIBLINGS = {
    "population/K/c.0": "population/M/c.0",
    "population/voltage_scale/c.0": "population/time_scale/c.0",
    "zarr.json": "candidates/digests/root.json",
}


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
    if (file.parent / "candidates").is_dir():  # the store's own folder is the user's
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


@dataclass(frozen=True)
class Looked:
    """What a command has asked of a store's folder: keys, and the names in folders."""

    keys: set[str] = field(default_factory=set)
    folders: set[str] = field(default_factory=set)

    def sees(self, damage: Damaged) -> bool:
        """Whether it would meet anything of a damage; else it does what it did with the whole store."""
        return not self.keys.isdisjoint(damage.keys) or not self.folders.isdisjoint(damage.folders)


@dataclass(frozen=True)
class Damaged:
    """What a damage changed: keys with other bytes or of another sort, folders with other names in them."""

    keys: set[str]
    folders: set[str]


@contextmanager
def looking(root: Path) -> Iterator[Looked]:
    """Note every key and folder below root that is looked at: all of it goes through one class."""
    found = Looked()
    folder, names = Below._folder, Below.names

    def noted_folder(self: Below, key: str, **named: bool) -> Any:
        if self.root == str(root):
            found.keys.add(key)
        return folder(self, key, **named)

    def noted_names(self: Below, prefix: str = "") -> Any:
        if self.root == str(root):
            found.folders.add(prefix.strip("/"))
        return names(self, prefix)

    with patch.object(Below, "_folder", noted_folder), patch.object(Below, "names", noted_names):
        yield found


@dataclass
class Case:
    """A whole store, and what the commands say of it."""

    sort: str
    whole: Path
    """Never changed."""
    path: Path
    """Where damaged copies of it lie: answers name the path."""
    answers: dict[str, Result] = field(default_factory=dict)
    looks: dict[str, Looked] = field(default_factory=dict)
    """Where each command looks in the whole store."""
    known: dict[str, tuple[Signature, bytes]] = field(default_factory=dict)
    """Files at the case's place as they were copied."""
    spared: int = 0
    """Commands that were not asked about a damage, as they look at nothing of it."""
    asked: int = 0
    """Commands that were."""
    results: dict[str, dict[str, bytes]] = field(default_factory=dict)
    """What a writing command leaves of the whole store."""

    @property
    def commands(self) -> dict[str, tuple[str, ...]]:
        """What is asked of this store."""
        every = READING | WRITING
        return {name: every[name] for name in ONLY.get(self.sort, every)}

    @cached_property
    def written(self) -> dict[str, bytes]:
        """The whole store's files."""
        return contents(self.whole)

    @cached_property
    def names(self) -> dict[str, set[tuple[str, bool]]]:
        """The whole store's folders, and the names in them."""
        return named(self.whole)

    @cached_property
    def folders(self) -> set[str]:
        """The whole store's folders."""
        return {key for key, entry in entries(self.whole) if entry.is_dir(follow_symlinks=False)}

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


Signature = tuple[int, int, int]
"""Number, time of change [ns] and size of a file: they are other ones once it has been written or replaced."""


def entries(path: Path) -> Iterator[tuple[str, os.DirEntry[str]]]:
    """(key, entry) of everything below a folder, folders before what is in them; links are not followed."""
    pending = [("", os.fspath(path))]
    while pending:
        prefix, folder = pending.pop()
        if not os.path.isdir(folder):
            continue
        with os.scandir(folder) as found:
            for entry in found:
                yield prefix + entry.name, entry
                if entry.is_dir(follow_symlinks=False):
                    pending.append((f"{prefix}{entry.name}/", entry.path))


def signature(entry: os.DirEntry[str]) -> Signature:
    """Of the file, or link, itself."""
    found = entry.stat(follow_symlinks=False)
    return found.st_ino, found.st_mtime_ns, found.st_size


def contents(path: Path, known: Mapping[str, tuple[Signature, bytes]] | None = None) -> dict[str, bytes]:
    """Key -> bytes of every file below a folder, links as what they say. known: of files that need not be read."""
    found = {}
    for key, entry in entries(path):
        if entry.is_symlink():
            found[key] = b"-> " + os.fsencode(os.readlink(entry.path))
        elif entry.is_file(follow_symlinks=False):
            had = known.get(key) if known else None
            found[key] = had[1] if had and had[0] == signature(entry) else Path(entry.path).read_bytes()
        elif not entry.is_dir(follow_symlinks=False):
            found[key] = b"special"
    return found


def named(path: Path) -> dict[str, set[tuple[str, bool]]]:
    """Folder -> the names in it, and whether each is a folder."""
    found: dict[str, set[tuple[str, bool]]] = {}
    for key, entry in entries(path):
        found.setdefault(key.rpartition("/")[0], set()).add((entry.name, entry.is_dir(follow_symlinks=False)))
    return found


def fresh(case: Case) -> Path:
    """The whole store at the case's place: what is not as it was copied is copied again."""
    shutil.rmtree(f"{case.path}.strays", ignore_errors=True)
    if not case.path.is_dir():
        case.known.clear()
        shutil.copytree(case.whole, case.path)
    there, folders = set(), []
    for key, entry in entries(case.path):
        if entry.is_dir(follow_symlinks=False):
            folders.append(key)
        elif key in case.known and case.known[key][0] == signature(entry):
            there.add(key)
    for key in sorted(folders, reverse=True):
        if key not in case.folders:
            shutil.rmtree(case.path / key)
    for key in [key for key, entry in entries(case.path) if not entry.is_dir(follow_symlinks=False)]:
        if key not in case.written:
            (case.path / key).unlink()
    for key, content in case.written.items():
        if key not in there:
            file = case.path / key
            for folder in [*reversed(file.parents)][len(case.path.parts) :]:
                if folder.is_symlink() or folder.is_file():
                    folder.unlink()
                folder.mkdir(exist_ok=True)
            file.unlink(missing_ok=True)
            shutil.copy2(case.whole / key, file)
            found = file.lstat()
            case.known[key] = (found.st_ino, found.st_mtime_ns, found.st_size), content
    return case.path


def now(case: Case) -> dict[str, bytes]:
    """Contents of the store at the case's place."""
    return contents(case.path, case.known)


def difference(case: Case, after: dict[str, bytes]) -> Damaged:
    """What has changed of the whole store at the case's place."""
    before = case.written
    keys = {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
    has = named(case.path)
    folders = {name for name in case.names.keys() | has.keys() if case.names.get(name) != has.get(name)}
    return Damaged(keys | folders, folders)


def ask(case: Case, command: tuple[str, ...], out: Path) -> Result:
    """What a command says of the store at the case's place."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    more = str(open_campaign(case.whole).budget + 4)
    return CliRunner().invoke(main, [part.format(store=case.path, out=out, more=more) for part in command])


def run_case(
    case: Case,
    kind: str,
    damage: str,
    commands: dict[str, tuple[str, ...]],
    *,
    repair: bool = True,
    turn: int | None = None,
    few: int = 2,
) -> list[str]:
    """Everything that is wrong about the answers to one damage. turn: few of the commands that meet it, which in turn.

    None: all of them.
    """
    key = case.kinds[kind]
    out, outside = case.path.parent / "out", case.path.parent / "outside"  # answers name where they were written
    wrong = []

    def asked(name: str, command: tuple[str, ...], check: Callable[[Answer], str]) -> None:
        case.asked += 1
        before = contents(outside)
        problem = check(ask_timed(case, command, out))
        if contents(outside) != before:
            problem = "touched what lies outside"
        if problem:
            wrong.append(f"{case.sort}, {kind} {damage}, {name}: {problem}")

    for name, command in commands.items():
        if name not in case.answers:
            fresh(case)
            with looking(case.path) as case.looks[name]:
                case.answers[name] = ask(case, command, out)
            assert case.answers[name].exit_code == 0, case.answers[name].output
            case.results[name] = now(case)
    _damaged(case, key, damage, outside)
    told = now(case)
    changed = difference(case, told)
    met = {name for name in commands if case.looks[name].sees(changed) or _drawn(case, kind, damage, name)}
    case.spared += len(commands) - len(met)
    if turn is not None:
        ordered = sorted(met)
        met = {ordered[(few * turn + n) % len(ordered)] for n in range(few)} if met else met
    for name in sorted(met & READING.keys()):
        asked(name, commands[name], lambda answer, name=name: _answer(case, name, answer, key, told))
    assert now(case) == told, f"{kind} {damage}: a command that reads has written"
    if repair:
        asked("repair", ("verify", "{store}", "--repair"), lambda answer: _repaired(case, answer))
    for name in sorted(met & WRITING.keys()):
        _damaged(case, key, damage, outside)
        asked(name, commands[name], lambda answer, name=name: _answer(case, name, answer, key, told))
    return wrong


def _drawn(case: Case, kind: str, damage: str, name: str) -> bool:
    """Of the commands that look at nothing of a damage one in twenty is asked all the same."""
    return zlib.crc32(f"{case.sort} {kind} {damage} {name}".encode()) % 20 == 0


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
            wrote = {k: v for k, v in now(case).items() if k not in told or told[k] != v}
            other = [k for k, v in wrote.items() if case.results[name].get(k) != v and not _may_differ(k)]
            if other:
                return f"wrote {other[:3]} otherwise"
        return "" if result.output == whole.output else f"said {_first_difference(whole.output, result.output)}"
    text = result.output
    folders = (place.rpartition("/")[0] or place for place in (key, case.sibling(key)))
    named = any(place in text for place in folders) or ("block_digest" in key and "block (" in text)
    if result.exit_code != 1 or not named or "softclose verify" not in text or "--repair" not in text:
        return f"exit {result.exit_code}: {text[-400:]}"
    return ""


def _first_difference(a: str, b: str) -> str:
    for left, right in zip(a.splitlines(), b.splitlines(), strict=False):
        if left != right:
            return f"{right!r} instead of {left!r}"
    return f"{b[-200:]!r} instead of {a[-200:]!r}"


def _may_differ(key: str) -> bool:
    return key in ("zarr.json", "runtime/zarr.json", "candidates/digests/root.json") or key.startswith(
        "candidates/wall_times/"
    )


def _repaired(case: Case, answer: Answer) -> str:
    result = answer[0]
    if problem := _unfit(answer):
        return problem
    has, was = now(case), case.written
    different = sorted(k for k in has.keys() | was.keys() if has.get(k) != was.get(k) and not k.endswith("driver.lock"))
    if result.exit_code == 0:
        bad = [
            k
            for k in different
            if not (k.startswith("candidates/wall_times/") and "timings" in result.output)
            and not (k in ("zarr.json", "runtime/zarr.json") and "who ran" in result.output)
        ]
        return f"left {bad[:4]} otherwise: {result.output[-600:]}" if bad else ""
    return f"exit {result.exit_code}: {result.output[-600:]}"
