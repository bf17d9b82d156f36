"""Owns what a check of a store says: its problems, one by one, and the report of them all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ProblemKind = Literal[
    "root", "schema", "static", "proposal", "record", "timings", "block", "pending", "group", "listing", "unknown"
]  # fmt: skip
BlockOf = tuple[str, int, int]
"""(stage, i_block, j_block)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """One thing that is not what was written."""

    kind: ProblemKind
    """root: identity, layout or commit marker; schema: metadata of an array; static: population or coordinates;
    proposal, record, timings: values of a candidate; block: data of committed candidates; pending: of those that are
    not committed yet (resuming computes them again); group: a result group; listing: what the root lists of them;
    unknown: a file of nothing in the store."""
    what: str
    """What is wrong, in words."""
    key: str = ""
    """The file, where it is one's."""
    candidate: int | None = None
    """The candidate, where it is one's."""
    block: BlockOf | None = None
    """The block, where it is one's."""
    group: str = ""
    """The result group, where it is one's."""

    def __str__(self) -> str:
        return f"{self.kind}: {self.what}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What `verify` found."""

    path: str
    """The store."""
    n_committed: int
    """Committed candidates; where the root is damaged, what everything that remains says."""
    n_blocks: int
    """Blocks read and compared with their markers."""
    problems: tuple[Damage, ...]
    """All damage."""
    orphans: tuple[str, ...]
    """What a kill left behind, temporary files and trajectories of no group (yet): harmless, `remove_orphans` deletes
    them."""
    extension: int = 0
    """Candidates that the campaign will have once an extension is complete that was cut off; 0 where none was."""

    unlisted: tuple[str, ...] = ()
    """Result groups that are whole, and that the root does not list yet: `xarray.open_datatree` does not show them."""

    @property
    def ok(self) -> bool:
        """True where nothing is damaged."""
        return not self.problems

    @property
    def damaged_blocks(self) -> list[BlockOf]:
        """(stage, i_block, j_block) to be computed again, in order."""
        return sorted({p.block for p in self.problems if p.kind == "block" and p.block is not None})

    @property
    def damaged_records(self) -> list[int]:
        """Candidates whose proposal, record or timings are damaged, in order."""
        kinds = ("proposal", "record", "timings")
        return sorted({p.candidate for p in self.problems if p.kind in kinds and p.candidate is not None})

    @property
    def damaged_groups(self) -> list[str]:
        """Result groups that are not what was written, in order."""
        return sorted({p.group for p in self.problems if p.group})
