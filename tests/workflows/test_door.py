"""Claims about the one door: what a store holds is checked before it is believed, and nothing leads out of it."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from door import DAMAGES, KINDS, READING, SORTS, WRITING, Case, ask, contents, fresh, make_cases, run_case
from examples import in_turn
from small_campaigns import COARSE, COMPLETE, finish, make_campaign
from softclose import ALGORITHM
from softclose.settings import load_config
from softclose_store import DamageError, create_campaign, group_attributes, list_groups, open_campaign, repair, verify
from softclose_store.disk import below
from softclose_store.schema.opening import decode_root
from softclose_workflows.analyses.certify import certify, certify_again
from softclose_workflows.analyses.recompute import recompute
from softclose_workflows.run.creation import layout_of, population_columns
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.extension import extend
from stores import differences

EVERYWHERE = {
    *("root", "copy of the root", "runtime", "stage", "array", "population", "instants", "records", "words", "timings"),
    *("digest", "response", "impacts", "motion", "marker"),
}
"""Kinds of files that every sort has."""

QUICK = ("status", "export ensemble", "rescore", "resume")
"""Commands of the short tests: they read records, lot, motion and responses."""


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return make_cases(tmp_path_factory.mktemp("certified"), ["certified"])["certified"]


@pytest.fixture(scope="module")
def smallest(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A certified campaign of two candidates: it is copied and mended for each of hundreds of kills."""
    folder = tmp_path_factory.mktemp("smallest")
    make_campaign(folder / "whole.zarr", *COARSE, "campaign.budget=2", "population.n_switches=20")
    certify(str(folder / "whole.zarr"), n_switches=60, top=1)
    return Case("smallest", folder / "whole.zarr", folder / "a.zarr")


@pytest.fixture(scope="module")
def case_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Case]:
    """A store of a sort, made where it is first asked for."""

    @cache
    def made(sort: str) -> Case:
        return make_cases(tmp_path_factory.mktemp("sort"), [sort])[sort]

    return made


@pytest.mark.slow
@pytest.mark.parametrize("damage", in_turn(DAMAGES, 5))
def test_one_damaged_file_is_refused_by_name_or_makes_no_difference(damage: str, certified: Case) -> None:
    kinds = [kind for kind in KINDS if kind in certified.kinds]
    at = list(DAMAGES).index(damage)
    commands = {name: (READING | WRITING)[name] for name in QUICK}
    assert run_case(certified, kinds[(5 * at) % len(kinds)], damage, commands) == []


@pytest.mark.parametrize("kind", in_turn(["certificates", "metadata of a certificate"], 2))
def test_of_a_folder_that_leads_elsewhere_the_root_says_what_was_certified(kind: str, certified: Case) -> None:
    """Nothing is left of the certificate's metadata: what it was asked for comes from the root, as does its digest.

    Till then no command takes the campaign for one that nobody has certified.
    """
    commands = {name: READING[name] for name in ("status", "compare", "report")}
    assert run_case(certified, kind, "linked_folder", commands) == []


@pytest.mark.parametrize("damage", in_turn(["swapped", "foreign"], 2))
def test_no_command_takes_the_root_of_the_creation_for_that_of_now(damage: str, certified: Case) -> None:
    assert run_case(certified, "root", damage, {name: WRITING[name] for name in ("resume", "extend")}) == []


def test_a_root_is_checked_once_and_nobody_changes_what_was_read(certified: Case, tmp_path: Path) -> None:
    path = fresh(certified)
    content = (path / "zarr.json").read_bytes()
    decode_root.cache_clear()
    root = decode_root(content, str(path))
    for command in certified.commands.values():
        if command in READING.values():
            assert ask(certified, command, tmp_path / "out").exit_code == 0
    assert decode_root.cache_info().misses <= 2  # some commands name the path otherwise
    assert decode_root(content, str(path)) is root
    assert root.encode() == content


PARTS = 4
"""Tests of a sort, so that processes share them."""


def damages_of(sort: str, kinds: Iterable[str]) -> list[tuple[str, str]]:
    """(kind, damage) that are tried on a sort: of the kinds that every sort has each pair on every second sort, in
    turn, of the others all."""
    first = list(SORTS).index(sort)
    every = [(kind, damage) for kind in kinds for damage in DAMAGES]
    pairs = [(kind, damage) for kind in KINDS for damage in DAMAGES]
    return [pair for pair in every if pair[0] not in EVERYWHERE or (pairs.index(pair) + first) % 2 == 0]


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("sort", SORTS)
def test_every_damage_of_every_file_of_every_sort(sort: str, part: int, case_of: Callable[[str], Case]) -> None:
    """Every damage of every kind of file, and of the commands that meet it one on each sort, in turn.

    Of kinds that few sorts have two of them. All on all sorts would take an hour. Repair is asked a third of the time.
    """
    case, wrong = case_of(sort), []
    first = list(SORTS).index(sort)
    every = damages_of(sort, case.kinds)
    for at in range(part, len(every), PARTS):
        kind, damage = every[at]
        few, turn = 1 if kind in EVERYWHERE else 2, at // PARTS + first
        wrong += run_case(case, kind, damage, case.commands, repair=at % 3 == 0, turn=turn, few=few)
    assert wrong == []
    assert case.asked > len(every) // PARTS


def test_each_damage_of_a_kind_that_all_sorts_have_is_tried_on_half_of_them() -> None:
    tried = Counter(pair for sort in SORTS for pair in damages_of(sort, KINDS))
    assert {kind for kind, _ in tried} == set(KINDS)
    for (kind, _damage), n in tried.items():
        assert n == (len(SORTS) // 2 if kind in EVERYWHERE else len(SORTS))


@pytest.mark.long
def test_the_sorts_have_a_file_of_every_kind(case_of: Callable[[str], Case]) -> None:
    has = [set(case_of(sort).kinds) for sort in SORTS]
    assert set().union(*has) == set(KINDS)
    assert set.intersection(*has) == EVERYWHERE


class Dying:
    """Stands for `os` at the door: the process ends before its k-th rename or removal, as by SIGKILL."""

    def __init__(self, at: int) -> None:
        self.at = at
        self.count = 0

    def __getattr__(self, name: str) -> Any:
        real = getattr(os, name)
        if name not in ("replace", "rename", "unlink", "rmdir"):
            return real

        def operation(*arguments: Any, **named: Any) -> Any:
            self.count += 1
            if self.count == self.at:
                os._exit(9)
            return real(*arguments, **named)

        return operation


@contextmanager
def dying(at: int) -> Iterator[Dying]:
    with pytest.MonkeyPatch.context() as patch:
        fake = Dying(at)
        patch.setattr(below, "os", fake)
        yield fake


def killed_at(at: int, work: Callable[[], Any]) -> bool:
    """Do something in a process that ends before its k-th rename or removal; whether it did."""
    child = os.fork()
    if child == 0:
        try:
            with dying(at):
                work()
        except BaseException:
            import traceback

            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 9), code
    return code == 9


def damaged_group(path: Path) -> None:
    """One flipped byte in a certificate."""
    name = list_groups(path)[0]
    file = path / name / "max_contact_speed" / "c" / "0" / "0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def damaged_widely(path: Path) -> None:
    """A table, a block, its marker, the population, an array's metadata; a stray."""
    block = sorted(file.relative_to(path).as_posix() for file in (path / "search" / "x").glob("c.*"))[-1]
    for key in (
        "population/K/c.0",
        "candidates/records/c.0.0",
        "search/block_digest/c.0.0.0",
        block,
        "candidates/records/zarr.json",
    ):
        (path / key).unlink()
    (path / "notes.txt").write_text("mine")


def mend(path: Path) -> None:
    assert repair(path, recompute()).ok


def again(path: Path) -> None:
    name = list_groups(path)[0]
    certify_again(str(path), name, group_attributes(path, name))


def longer(path: Path) -> None:
    extend(str(path), open_campaign(path).budget + 4 if open_campaign(path).finished else open_campaign(path).budget)


WORKS: dict[str, tuple[Callable[[Path], None], Callable[[Path], None]]] = {
    "repair of a group": (damaged_group, mend),
    "repair of everything": (damaged_widely, mend),
    "group written again": (damaged_group, again),
    "extension": (lambda path: None, longer),
}
"""What is done to a store first, and the work within which it is killed."""


def instants(n: int, edge: int, step: int) -> list[int]:
    """Which of n renames and removals: the first and the last `edge`, and every step-th between them."""
    return [at for at in range(1, n + 1) if at <= edge or at > n - edge or at % step == 0]


def _kill_within(name: str, case: Case, folder: Path, edge: int, step: int) -> None:
    before, work = WORKS[name]
    path = folder / "a.zarr"

    def made() -> Path:
        for place in (path, folder / "a.zarr.strays"):
            shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(case.whole, path)
        before(path)
        return path

    made()
    with dying(0) as counted:
        work(path)
    finish(path)
    whole = contents(path)
    assert counted.count > 3
    for at in instants(counted.count, edge, step):
        assert killed_at(at, lambda: work(made()))
        for first in ("repair", "resume") if name == "extension" else ("repair",):
            copy = folder / "copy.zarr"
            for place in (copy, folder / "copy.zarr.strays"):
                shutil.rmtree(place, ignore_errors=True)
            shutil.copytree(path, copy)
            if first == "repair":
                mend(copy)
            drive(str(copy), Placement(serial=True), quiet=True)  # of a finished store everything is compared
            assert first == "resume" or not [key for key in contents(copy) if key.endswith(".partial")]
            if name != "extension" or open_campaign(copy).budget > open_campaign(case.whole).budget:
                now = contents(copy)
                other = [k for k in whole if now.get(k) != whole[k] and not _of_the_clock(k)]
                assert other == [], (name, at, first, other)
            else:
                assert differences(copy, case.whole) == []


def _of_the_clock(key: str) -> bool:
    return key in ("zarr.json", "runtime/zarr.json", "candidates/digests/root.json") or key.startswith(
        "candidates/wall_times/c"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", in_turn(WORKS, 4))
def test_a_kill_within_repair_extension_or_a_group_is_mended(name: str, smallest: Case, tmp_path: Path) -> None:
    _kill_within(name, smallest, tmp_path, edge=1, step=997)


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", WORKS)
def test_a_kill_at_any_rename_and_removal_is_mended(name: str, smallest: Case, tmp_path: Path) -> None:
    """A group of some fifty arrays is written by two hundred of them, which differ by the array's name only."""
    _kill_within(name, smallest, tmp_path, edge=8, step=17)


def test_sizes_that_do_not_follow_from_the_configuration_are_not_driven(tmp_path: Path) -> None:
    config = load_config("current", COMPLETE)
    sizes = layout_of(config)
    create_campaign(
        tmp_path / "a.zarr",
        layout=replace(sizes, max_impacts=sizes.max_impacts + 1),
        config=config.to_dict(),
        population=population_columns(config),
        algorithm=ALGORITHM,
    )
    with pytest.raises(DamageError, match=r"zarr.json of .* says other sizes than follow from the configuration in it"):
        drive(str(tmp_path / "a.zarr"), Placement(serial=True), quiet=True)


def test_a_lock_that_leads_elsewhere_is_not_written_through(certified: Case, tmp_path: Path) -> None:
    path = Path(shutil.copytree(certified.whole, tmp_path / "a.zarr"))
    outside = tmp_path / "precious"
    outside.write_text("mine")
    lock = path / "candidates" / "digests" / "driver.lock"
    lock.symlink_to(outside)
    assert any("driver.lock does not belong" in str(p) for p in verify(path).problems)
    with pytest.raises(DamageError, match=r"driver.lock is a link"):
        longer(path)
    mend(path)
    lock.hardlink_to(outside)
    longer(path)
    assert outside.read_text() == "mine"
    assert open_campaign(path).budget > open_campaign(certified.whole).budget
