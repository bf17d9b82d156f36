"""Owns what only a repair may do to a store: set committed values again, in memory, and write all tables at the end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store.disk.files import StorePath
from softclose_store.disk.names import chunk_key
from softclose_store.read.blocks import markers_digest
from softclose_store.read.table import FAILURE, MARKERS, RECORD
from softclose_store.schema.fields import DIGESTS
from softclose_store.schema.hierarchy import HYPERPARAMETER, HYPERPARAMETER_UNIT, TABLES
from softclose_store.schema.opening import write_root
from softclose_store.write.driver import Block, DriverStore
from softclose_store.write.rows import (
    ASSESSED,
    PROPOSED,
    check_names,
    set_proposal,
    set_result,
    set_timings,
    write_hyperparameters,
    write_rows,
)


class RepairStore(DriverStore):
    """A damaged store in the hands of its repair, under the driver's lock."""

    def __init__(self, path: StorePath, *, break_lock: bool = False) -> None:
        super().__init__(path, break_lock=break_lock, tolerate_damage=True)

    def wave_blocks(self, start: int, size: int) -> list[Block]:
        """All blocks of a committed wave."""
        n_switches = max(self._table.n_switches(i) for i in range(start, start + size))
        return self.layout.wave_blocks(start, size, n_switches)

    def proposals_digest(self, stage: str, i_block: int) -> int:
        """Digest of the proposals of one row of blocks, as the records have them."""
        return self._table.block_proposals(self.layout.stage(stage), i_block)[0]

    def stored_digests(self, i: int) -> dict[str, int]:
        """Digests of the stored proposal, markers and record of candidate i; 0 where there is none."""
        return dict(zip(DIGESTS, (int(digest) for digest in self._table.digests[i]), strict=True))

    def candidate_markers(self, i: int) -> int:
        """Digest of the markers of candidate i's blocks as they are on the disk: ties its record to its data."""
        stage, local = self.layout.stage_of(i)
        return self._digest_of_row(stage.name, local // stage.block_candidates, i, {})

    def _digest_of_row(self, stage: str, i_block: int, i: int, found: Mapping[int, NDArray[np.uint64]]) -> int:
        columns = range(self.layout.stage(stage).blocks_of(self._table.n_switches(i)))
        stored = self.markers(stage, [(i_block, j) for j in columns])
        return markers_digest(np.stack([found.get(j, stored[i_block, j]) for j in columns]), i)

    def told_by_records(self, stage: str, i_block: int, found: Mapping[int, NDArray[np.uint64]]) -> bool | None:
        """Whether the records of a row of blocks were written for these markers; None where no record is intact.

        found: markers of the blocks that were computed again, by column; the others' are those on the disk.
        """
        rows, first = self.layout.stage(stage).candidates(i_block), self.layout.first(stage)
        intact = [
            i
            for i in range(first + rows.start, first + rows.stop)
            if int(self._table.digests[i, RECORD]) == self._table.record_digest(i)
        ]
        if not intact:
            return None
        return all(
            self._digest_of_row(stage, i_block, i, found) == int(self._table.digests[i, MARKERS]) for i in intact
        )

    def lost_names(self) -> bool:
        """True where a quantity of a surrogate is stored whose name nothing says any more."""
        return self._table.n_hyperparameters() > len(self._hyperparameters)

    def learn_names(self, row: Mapping[str, Any]) -> None:
        """Take the names of a proposal's surrogate quantities, in the order in which a commit would have met them."""
        surrogate = dict(row.get("surrogate") or {})
        self._hyperparameters += [name for name in surrogate if name not in self._hyperparameters]

    def restore_proposal(self, i: int, row: Mapping[str, Any]) -> tuple[int, bool]:
        """Set the proposal of candidate i in memory only, for a repair.

        Returns its digest, and whether these values were there already: then it was the digest that was damaged.
        """
        check_names(row, PROPOSED)
        before = self._table.proposal_digest(i)
        found = set_proposal(self._table, i, row, self._hyperparameters)
        return found, found == before

    def restore_record(self, i: int, row: Mapping[str, Any], wave: int) -> tuple[int, bool]:
        """Set the record of candidate i in memory only, for a repair; returns the same of it."""
        check_names(row, ASSESSED | {field.name for field in self.layout.results})
        at = self.layout.n_proposal_fields
        before = self._table.records[i, at:].tobytes(), str(self._table.words[i, FAILURE])
        found = set_result(self._table, i, row, wave, self.candidate_markers(i))
        return found, before == (self._table.records[i, at:].tobytes(), str(self._table.words[i, FAILURE]))

    def restore_timings(self, i: int) -> None:
        """Set the timings of candidate i to nothing in memory, for a repair: they are lost."""
        set_timings(self._table, i, {})

    def restored_keys(self) -> list[str]:
        """Keys of the files that `write_restored` writes, the root apart."""
        step = self.layout.table_chunk
        n_chunks = -(-self.n_committed // step)
        tables = [chunk_key(name, i, 0) for name in TABLES for i in range(n_chunks)]
        return [*(chunk_key(name, 0) for name in (HYPERPARAMETER, HYPERPARAMETER_UNIT)), *tables]

    def write_restored(self) -> None:
        """Write all tables and names of the committed candidates: the last step of a repair."""
        self._lock.check()
        write_hyperparameters(self._arrays, self._files, self._hyperparameters)
        if self.n_committed:
            write_rows(self._table, self._files, self._arrays, 0, self.n_committed)
        if self._hyperparameters != self._root.attributes["hyperparameters"]:
            root = self._root.committed(self.n_committed, self.n_waves, self._hyperparameters)
            write_root(self._files.inner, root)
            self._root = root
