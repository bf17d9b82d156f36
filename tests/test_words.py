"""Claims about words: what users read is said in the field's terms, and cites nothing that users do not have.

It looks at the README, the site but for its decision records and measurements, help texts, and every text and public
docstring of the packages and scripts. Each entry is a phrase that readers stumbled over, and what to say instead.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest

from softclose_workflows.cli import main

ROOT = Path(__file__).parents[1]
SOURCES = ("pipeline", "store", "workflows", "scripts")
TERSE = {"adr", "measurements", "_build"}

INSTEAD = {
    r"flatter(y|s|ed|ing)?\b": "a training score is optimistic",
    r"\bchosen on\b": "that the search never saw; tuned on",
    r"\bfresh switches\b": "new switches",
    r"\bsame bits\b": "bit-identical",
    r"How rare ever": "fraction of switches faster than v",
    r"\bslams?:|which (switches )?(slam|miss)": "hit too hard, stay open",
    r"not while watched|while it is watched": "not within the simulated time; after release",
    r"\bJudged are\b": "this is based on",
    r"leave the further modes alone": "do higher modes matter",
    r"devices leave open": "the uncertainty that comes from having measured few devices",
    r"the best is the best": "until the winner is certain",
    r"who is beaten": "eliminate losers",
    r"ensemble .{0,40}said g": "above the training score",
    r"^Public is": "only names exported here are public API",
    r"and more over a range": "at least 2 with low below high",
    r"is no scaled drive": "is not the scaled output",
    r"None of Eqs": "none for the single-mode model",
    r"changes? of its mind": "population size",
    r"known badly": "noisy measurements are shrunk towards the mean switch",
    r"model's own word": "deterministic failure",
    r"would be raised anywhere": "would occur on any machine",
    r"held only where both are": "closed only if closed in both",
    r"goes unseen": "never marks its jobs closed",
    r"is no promise": "is optimistic",
    r"knows no (Dask|Zarr)": "does not import",
    r"What a lot costs": "how good is the lot, and what would improve it",
    r"lot and objective are taken": "only the population and the objective are used",
    r"share of the box": "hypervolume (1 = ideal)",
    r"switches of training": "training switches",
    r"(?<!proposal's )surrogate believed|campaign believed": "predicted; its own scores",
    r"\bSPEC\b|\bSPEC\.md|\bDESIGN( §|\.md)": "the equation, the paper, or a page of the site",
}
"""Pattern -> what to say."""

ALLOWED = {("docs/how-to/front.md", r"share of the box")}
"""Where a phrase is explained."""


def texts() -> Iterator[tuple[str, str]]:
    """(where, text) of everything that a user may read."""
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        if page.exists() and not TERSE & set(page.relative_to(ROOT).parts):
            yield str(page.relative_to(ROOT)), page.read_text("utf-8")
    for folder in SOURCES:
        for file in (ROOT / folder).rglob("*"):
            where = str(file.relative_to(ROOT))
            if file.suffix in (".j2", ".js", ".toml"):
                yield where, file.read_text("utf-8")
            elif file.suffix == ".py":
                for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                    if isinstance(node, ast.Constant) and isinstance(node.value, str):
                        yield f"{where}:{node.lineno}", node.value


@cache
def every() -> list[tuple[str, str]]:
    """All of them, on one line each."""
    return [(where, re.sub(r"\s+", " ", text)) for where, text in texts()]


@pytest.mark.parametrize(("pattern", "better"), INSTEAD.items(), ids=[*INSTEAD.values()])
def test_nobody_reads_a_word_of_the_house(pattern: str, better: str) -> None:
    found = [
        f"{where}: {match.group(0)}"
        for where, text in every()
        if (match := re.search(pattern, text, re.MULTILINE)) and (where, pattern) not in ALLOWED
    ]
    assert found == [], f"say: {better}"


def test_everything_that_a_user_reads_is_looked_at() -> None:
    wheres = {where.partition(":")[0] for where, _ in every()}
    for expected in (
        "README.md",
        "docs/tutorial.md",
        "docs/how-to/compare.md",
        "workflows/softclose_workflows/commands/certify.py",
        "workflows/softclose_workflows/report/assets/report.html.j2",
        "workflows/softclose_workflows/report/assets/live.js",
        "pipeline/softclose/settings/objective.py",
        "store/softclose_store/read/reader.py",
    ):
        assert expected in wheres


def commands(command: click.Command = main, path: str = "softclose") -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        for name, sub in command.commands.items():
            yield from commands(sub, f"{path} {name}")


@pytest.mark.parametrize(("path", "command"), [*commands()], ids=[path for path, _ in commands()])
def test_help_begins_with_a_full_sentence_that_says_what_to_do(path: str, command: click.Command) -> None:
    first = (command.help or "").partition("\n\n")[0].replace("\n", " ").strip()
    assert first.endswith("."), first
    assert re.match(r"[A-Z][a-z]+ ", first), first
    verbs = (
        "Judge Fit Rank Compare Print Show Write Design List Estimate Reproduce Run Continue Say Check Make Describe"
    )
    assert first.split()[0] in [*verbs.split(), "Describe"], first
