"""Damages stores at random, and looks whether `verify` finds it and one pass of `verify --repair` mends it.

`make damage` does 1,000 damages and writes docs/measurements/damage.md; the test suite does a few. Each follows from
the seed and its number alone: `python -m damage --only 17` repeats one and says what was done.

Two stores are damaged, each a copy: a finished campaign of three stages with two certifications, and one whose run was
killed with two waves in flight. What is asked of each damage:

* `verify` reports something, unless the store is one that a killed run could have left (a block in flight is gone).
* One pass of repair leaves a store in which `verify` finds nothing.
* Every file has its bytes again. Timings that were damaged may be lost, blocks in flight that were damaged may be gone;
  who ran the campaign may be lost where both copies were damaged. Each is said.
* The killed run's store ends in the bits of the uninterrupted one.
* Where nothing is left to repair from, the error says what is gone.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from small_campaigns import finish, make_complete
from softclose_store import DamageError, RepairReport, open_campaign, repair, verify
from softclose_workflows.analyses.recompute import recompute
from stores import differences, files_of

PAGE = Path(__file__).parents[1] / "docs" / "measurements" / "damage.md"
ONE = ("flip", "truncate", "empty", "zero", "delete", "rename", "duplicate", "swap", "append", "stray")
"""Ways to damage a store at one place."""
KINDS = (*ONE, "four at once")
HALTED_AFTER = 14
"""Blocks after which the second store's run ends: within the waves of the descents."""
NAMES = ("zarr.json", "c.0", "c.0.0", "c.0.0.0", "c.9.9.9", "zarr.json (copy)", "notes.txt", "zarr.json~", ".DS_Store")
"""What a stray file may be called."""


@dataclass(frozen=True)
class Case:
    """A store to be damaged."""

    name: str
    path: Path
    contents: Mapping[str, bytes]
    """Key -> bytes, as it should be."""
    final: Path
    """The campaign run to its end without interruption."""
    pending: frozenset[str]
    """Files of blocks that are not committed."""
    unseen: frozenset[str]
    """Files whose loss makes the store of a run killed a little earlier, and those that nothing vouches for."""


@dataclass
class Outcome:
    """What became of one damage."""

    number: int
    case: str
    kind: str
    done: list[str]
    """What was done to which file."""
    keys: set[str] = field(default_factory=set)
    """Files that are not what they were."""
    found: bool = False
    silent: bool = False
    """True where nothing could be found."""
    lost: str = ""
    """The error, where too little was left."""
    said: list[str] = field(default_factory=list)
    """What the repair says is lost or unproved."""
    wrong: list[str] = field(default_factory=list)
    seconds: float = 0.0


def make_cases(folder: Path) -> list[Case]:
    """The two stores."""
    finished = Path(make_complete(folder / "finished.zarr"))
    killed = Path(make_complete(folder / "killed.zarr", blocks=HALTED_AFTER))
    left = killed / "explore" / "x" / f"c.0.0.0.{'0a' * 16}.partial"
    left.write_bytes(b"half a block")
    return [_case("finished", finished, finished), _case("killed", killed, finished)]


def _case(name: str, path: Path, final: Path) -> Case:
    campaign = open_campaign(path)
    contents = contents_of(path)
    pending, marked = set(), set()
    for key in contents:
        stage, _, rest = key.partition("/")
        array, _, chunk = rest.partition("/")
        if stage in campaign.stages and chunk.startswith("c.") and chunk.count(".") > 1:
            i, j = (int(n) for n in chunk.split(".")[1:3])
            if i * campaign.layout.stage(stage).block_candidates >= campaign.stages[stage]:
                pending.add(key)
                if array == "block_digest":
                    marked.add((stage, i, j))
    unseen = {k for k in contents if k.endswith(".partial")} | {"candidates/digests/driver.lock"}
    return Case(name, path, contents, final, frozenset(pending), frozenset(unseen))


def contents_of(path: Path) -> dict[str, bytes]:
    """Key -> bytes of every file."""
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files_of(path)}


def room_of(key: str) -> str:
    """What a file belongs to, for the choice of files and the table."""
    parts = key.split("/")
    if key in ("zarr.json", "candidates/digests/root.json", "runtime/zarr.json"):
        return key
    if len(parts) == 1 or parts[-1] in NAMES[5:]:
        return "stray"
    if parts[0] == "certification":
        return "certification, " + ("metadata" if parts[-1] in ("zarr.json", "group.json") else "data")
    if parts[-1] == "zarr.json":
        return "metadata of an array or a stage"
    if parts[-1].endswith(".partial"):
        return "left by a kill"
    if parts[0] in ("candidates", "population"):
        tables = ("records", "words", "digests", "surrogate", "wall_times")
        return f"table {parts[1]}" if parts[1] in tables else "population and names"
    return "marker" if parts[1] == "block_digest" else "block" if parts[-1].count(".") > 1 else "population and names"


def damage_once(path: Path, kind: str, rng: random.Random) -> str:
    """Damage a store in one way; returns what was done."""
    keys = sorted(k for k in contents_of(path) if not k.endswith(".partial") and k != "candidates/digests/driver.lock")
    rooms: dict[str, list[str]] = {}
    for key in keys:
        rooms.setdefault(room_of(key), []).append(key)

    def choose() -> str:
        # Half of the damages go to the many blocks, the other half to the few files that hold the rest together.
        return rng.choice(keys) if rng.random() < 0.5 else rng.choice(rooms[rng.choice(sorted(rooms))])

    key = choose()
    file, content = path / key, (path / key).read_bytes()
    match kind:
        case "flip" if content:
            at = rng.randrange(len(content))
            file.write_bytes(content[:at] + bytes([content[at] ^ (1 << rng.randrange(8))]) + content[at + 1 :])
        case "truncate" if content:
            file.write_bytes(content[: rng.randrange(len(content))])
        case "empty":
            file.write_bytes(b"")
        case "zero":
            start = rng.choice((0, rng.randrange(len(content) + 1)))
            file.write_bytes(content[:start] + bytes(len(content) - start))
        case "delete":
            file.unlink()
        case "append":
            file.write_bytes(content + rng.choice((rng.randbytes(1 + rng.randrange(8)), content, b"\0" * 4096)))
        case "rename":
            other = _new_name(path, key, rng)
            file.rename(other)
            return f"{kind} {key} to {other.relative_to(path)}"
        case "duplicate":
            other = path / choose() if rng.random() < 0.7 else _new_name(path, key, rng)
            other.write_bytes(content)
            return f"{kind} {key} over {other.relative_to(path)}"
        case "swap":
            alike = [k for k in keys if k.rpartition("/")[2] == key.rpartition("/")[2] and k != key]
            other = path / (rng.choice(alike) if alike and rng.random() < 0.7 else choose())
            file.write_bytes(other.read_bytes())
            other.write_bytes(content)
            return f"{kind} {key} and {other.relative_to(path)}"
        case "stray":
            other = _new_name(path, key, rng)
            other.write_bytes(rng.choice((b"", b"{}", content, rng.randbytes(40))))
            return f"{kind} {other.relative_to(path)}"
    return f"{kind} {key}"


def _new_name(path: Path, key: str, rng: random.Random) -> Path:
    """A name that nothing has, near a file: what a slip of the hand or a copying program makes."""
    folder, _, name = key.rpartition("/")
    while True:
        new = rng.choice((*NAMES, f"{name} (copy)", f"{name}.bak", f"{name}.partial", f"{name}.0", f"my notes/{name}"))
        other = path / folder / new
        if not other.exists():
            other.parent.mkdir(exist_ok=True)
            return other


def run_round(number: int, seed: int, cases: Sequence[Case], folder: Path) -> Outcome:
    """One damage, its finding and its repair."""
    began = time.perf_counter()
    rng = random.Random(f"{seed} {number}")
    case, kind = cases[number % len(cases)], KINDS[number // len(cases) % len(KINDS)]
    path = folder / "damaged.zarr"
    strays = folder / "damaged.zarr.strays"
    outcome = Outcome(number, case.name, kind, [])
    while not outcome.keys:  # two equal files were swapped: nothing was damaged
        shutil.rmtree(path, ignore_errors=True)
        shutil.rmtree(strays, ignore_errors=True)
        shutil.copytree(case.path, path)
        kinds = [rng.choice(ONE) for _ in range(4)] if kind == "four at once" else [kind]
        outcome.done = [damage_once(path, one, rng) for one in kinds]
        now = contents_of(path)
        outcome.keys = {k for k in now.keys() | case.contents.keys() if now.get(k) != case.contents.get(k)}
    try:
        _check(case, path, outcome)
    except Exception:
        outcome.wrong.append(traceback.format_exc(limit=-4))
    outcome.seconds = time.perf_counter() - began
    return outcome


def _check(case: Case, path: Path, outcome: Outcome) -> None:
    try:
        outcome.found = not verify(path).ok
    except Exception as e:
        if type(e).__module__ != "softclose_store.errors":
            raise
        outcome.found = True
    outcome.silent = not outcome.found and all(_may_be_unseen(case, path, key) for key in outcome.keys)
    if not outcome.found and not outcome.silent:
        outcome.wrong.append("not found")
    try:
        mended = repair(path, recompute())
    except DamageError as e:
        outcome.lost = str(e)
    else:
        outcome.said = list(mended.unproved)
        if mended.ok:
            outcome.wrong += list(_unequal(case, path, mended))
        else:
            outcome.lost = "; ".join((*mended.failed, *(str(p) for p in mended.after.problems)))
    if outcome.lost:
        if not _is_lost(case, outcome):
            outcome.wrong.append(f"not repaired: {outcome.lost}")
        return
    if case.path != case.final:
        finish(path)
        outcome.wrong += [f"after resuming: {name}" for name in differences(case.final, path) if _counts(name)]


def _counts(name: str) -> bool:
    return not name.startswith("certification/")


def _may_be_unseen(case: Case, path: Path, key: str) -> bool:
    """True for the file of a block in flight that is not marked now: as far as anyone knows it was not stored yet."""
    if key in case.unseen or key.endswith(".partial"):
        return True
    if key not in case.pending:
        return False
    stage, _, chunk = key.split("/")
    i, j = chunk.split(".")[1:3]
    return not (path / stage / "block_digest" / f"c.{i}.{j}.0").exists()


def _unequal(case: Case, path: Path, mended: RepairReport) -> list[str]:
    """Files that are not what they were, of those that have to be."""
    now = contents_of(path)
    said = " ".join(mended.unproved)
    unequal = []
    for key in sorted(now.keys() | case.contents.keys()):
        if (
            now.get(key) == case.contents.get(key)
            or key.endswith(".partial")
            or key == "candidates/digests/driver.lock"
        ):
            continue
        if key in case.pending and key not in now:
            continue  # the comparison after resuming says whether it came again
        if key.startswith("candidates/wall_times/c") and _timings_are_said(case, path, said):
            continue
        if key in ("zarr.json", "runtime/zarr.json") and "who ran" in said:
            continue
        unequal.append(f"{key} is not what it was")
    return unequal


def _timings_are_said(case: Case, path: Path, said: str) -> bool:
    was, now = (open_campaign(p).records()["wall_committed_unix_s"] for p in (case.path, path))
    return all(f"timings of candidate {i} are lost" in said for i in np.flatnonzero(was != now))


CERTIFICATES = ("certification/100-1", "certification/120-5")
LOST: tuple[tuple[str, Callable[[set[str]], bool]], ...] = (
    ("nothing says any more what this store is", lambda keys: {"zarr.json", "candidates/digests/root.json"} <= keys),
    (
        "its own metadata and their copy are lost",
        lambda keys: any({f"{name}/zarr.json", f"{name}/candidate/group.json"} <= keys for name in CERTIFICATES),
    ),
)
"""What an error says is gone, and when it may."""


def _is_lost(case: Case, outcome: Outcome) -> bool:
    return any(words in outcome.lost and when(outcome.keys) for words, when in LOST)


def page(outcomes: Sequence[Outcome], seed: int, seconds: float) -> str:
    """The page of the documentation."""
    lines = [
        "# What damage is found and repaired",
        "",
        f"`make damage` damages copies of two small stores {len(outcomes):,} times at random (seed {seed}) and looks",
        "whether `softclose verify` finds it and one pass of `softclose verify --repair` gives back the same bytes,",
        "file by file. One store is a finished campaign of three stages with two certifications, the other that of a",
        "run which was killed with waves in flight; that one is resumed afterwards and compared with the uninterrupted",
        "campaign. Half of the damages hit any file, the other half one kind of file after the other. "
        f"This run took {seconds / 60:.0f} min in one process.",
        "",
        "*Not there to be found*: a block in flight lost its marker, so the store is one that a run killed a little",
        "earlier leaves; the resume computes it. *Nothing to compare with*: repaired, but what proved it (a digest,",
        "timings, who ran it) was itself lost, which the repair says. *Too little left*: both copies of what names a",
        "store or a certification were damaged; the error says so, and what to do.",
        "",
    ]
    by_kind = {kind: [o for o in outcomes if o.kind == kind] for kind in KINDS}
    lines += _table("damage", by_kind)
    rooms: dict[str, list[Outcome]] = {}
    for o in outcomes:
        for room in {room_of(key) for key in o.keys if o.kind not in ("stray", "four at once")}:
            rooms.setdefault(room, []).append(o)
    lines += ["", "The single ones by what they hit (a swap hits two):", ""]
    lines += _table("hit", dict(sorted(rooms.items())))
    return "\n".join(lines) + "\n"


def _table(title: str, groups: Mapping[str, Sequence[Outcome]]) -> list[str]:
    heads = ("done", "found", "not there to be found", "repaired in one pass")
    heads += ("nothing to compare with", "too little left", "wrong")
    lines = [f"| {title} | {' | '.join(heads)} |", "| --- |" + " ---: |" * len(heads)]
    if title == "damage":
        groups = {**groups, "**all**": [o for group in groups.values() for o in group]}
    for name, group in groups.items():
        counts = (
            len(group),
            sum(o.found for o in group),
            sum(o.silent for o in group),
            sum(not o.lost and not o.wrong for o in group),
            sum(bool(o.said) and not o.lost and not o.wrong for o in group),
            sum(bool(o.lost) and not o.wrong for o in group),
            sum(bool(o.wrong) for o in group),
        )
        lines.append(f"| {name} | " + " | ".join(map(str, counts)) + " |")
    return lines


def main() -> int:
    """Do the rounds, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of single rounds; writes no page")
    options = parser.parse_args()
    began = time.monotonic()
    outcomes = []
    with tempfile.TemporaryDirectory() as scratch:
        cases = make_cases(Path(scratch))
        for number in options.only if options.only is not None else range(options.rounds):
            outcome = run_round(number, options.seed, cases, Path(scratch))
            outcomes.append(outcome)
            if outcome.wrong or options.only is not None:
                print(f"{number}: {outcome.case}: {'; '.join(outcome.done)}", flush=True)
                for what in (*outcome.wrong, *([outcome.lost] if options.only is not None else [])):
                    print(f"    {what}", flush=True)
    if options.only is None:
        PAGE.write_text(page(outcomes, options.seed, time.monotonic() - began), "utf-8")
    wrong = sum(bool(o.wrong) for o in outcomes)
    print(f"{len(outcomes)} damages, {wrong} wrong, {time.monotonic() - began:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
