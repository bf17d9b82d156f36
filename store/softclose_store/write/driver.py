"""Owns the driver's side of a store: what is there of a wave, and its commit, under the one-driver lock."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from softclose_store import faults
from softclose_store.disk.files import StorePath, normalised, open_files, write_key
from softclose_store.disk.lock import DriverLock
from softclose_store.errors import DamageError, OtherAlgorithmError, OtherConfigurationError, RecordError
from softclose_store.groups import GroupArray, write_group
from softclose_store.listing import listed_anew
from softclose_store.read.arrays import described, layout_of, open_arrays, population_of
from softclose_store.read.blocks import BlockReader, markers_digest
from softclose_store.read.by_hand import CHOSEN, Changed, name_of, read_by_hand
from softclose_store.read.described import never
from softclose_store.read.metadata import check_metadata
from softclose_store.read.table import FAILURE, RecordTable
from softclose_store.schema.digests import canonical_json, proposals_digest
from softclose_store.schema.hierarchy import HYPERPARAMETER, HYPERPARAMETER_UNIT, TABLES
from softclose_store.schema.layout import Layout
from softclose_store.schema.opening import read_root, write_root
from softclose_store.schema.root import RUNTIME_KEY, Root, runtime_text
from softclose_store.write.block import assessed_of
from softclose_store.write.by_hand import Change, readings_arrays, settled, waveform_arrays
from softclose_store.write.create import other_algorithm
from softclose_store.write.extend import complete_extension
from softclose_store.write.rows import (
    ASSESSED,
    PROPOSED,
    TIMED,
    check_names,
    check_waveform,
    design_of,
    n_switches_of,
    set_proposal,
    set_result,
    set_timings,
    write_hyperparameters,
    write_rows,
)

TAIL_BYTES = 64_000_000
"""Decoded bytes of the last committed blocks that every opening checks: about 0.1 s."""

Block = tuple[int, int]


class DriverStore:
    """One campaign's store, open for its one driver. A context manager that holds the lock.

    Raises LockedError, StoreMissingError, SchemaError, OtherConfigurationError (where `expected_fingerprint` differs),
    OtherAlgorithmError (where `expected_algorithm` does) and DamageError. `tolerate_damage` opens a damaged store for
    its repair.
    """

    def __init__(
        self,
        path: StorePath,
        *,
        expected_fingerprint: str | None = None,
        expected_algorithm: str | None = None,
        break_lock: bool = False,
        tolerate_damage: bool = False,
    ) -> None:
        self.path = normalised(path)
        self._plain = open_files(path, read_only=True)
        root = read_root(self._plain, self.path)
        if expected_fingerprint is not None and root.fingerprint != expected_fingerprint:
            raise OtherConfigurationError(
                f"{self.path} holds campaign {root.fingerprint[:12]}, not {expected_fingerprint[:12]}: its "
                "configuration is another one; give another path"
            )
        if expected_algorithm is not None and root.algorithm != expected_algorithm:
            raise OtherAlgorithmError(other_algorithm(self.path, root.algorithm, expected_algorithm))
        self._lock = DriverLock(path)
        self._lock.acquire(break_lock=break_lock)
        try:
            complete_extension(open_files(path, read_only=False), self.path)
            self._root: Root = read_root(self._plain, self.path)  # another driver may have committed meanwhile
            self._tolerates = tolerate_damage
            self._read = described(self._plain, self._root, self.path, never if tolerate_damage else None)
            self.layout: Layout = layout_of(self._read, self._root)
            whole = open_files(path, read_only=False, durable=self.durable)
            self._files = described(whole, self._root, self.path, never)
            self._blocks = BlockReader(self._read, self.layout)
            self._table = RecordTable(self.layout)
            self._table.load(self._read, self.n_committed, tolerate_damage=tolerate_damage)
            self._hyperparameters: list[str] = list(self._root.attributes["hyperparameters"])
            self._arrays = open_arrays(self._files, (*TABLES, HYPERPARAMETER, HYPERPARAMETER_UNIT))
            if not tolerate_damage:
                self._check_committed()
                self._root = listed_anew(self._files.inner, self._root)
        except BaseException:
            self._lock.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and not self._tolerates and self._lock.still_held():
                self._root = listed_anew(self._files.inner, self._root)  # groups that were written meanwhile
        finally:
            self.close()

    def close(self) -> None:
        """Release the lock."""
        self._lock.release()

    def check_held(self) -> None:
        """Raise LockedError where the store is not this driver's any more: its lock was given back, or broken."""
        self._lock.check()

    @property
    def config(self) -> dict[str, Any]:
        """The campaign's configuration."""
        config: dict[str, Any] = self._root.attributes["config"]
        return config

    @property
    def fingerprint(self) -> str:
        """Identity of the campaign's configuration."""
        return self._root.fingerprint

    @property
    def algorithm(self) -> str:
        """Version of the algorithms that the campaign was begun with."""
        return self._root.algorithm

    @property
    def durable(self) -> bool:
        """True where every file is synced to the disk before the commit that relies on it."""
        return bool(self._root.attributes["durable"])

    @property
    def n_committed(self) -> int:
        """Number of committed candidates: always the first ones."""
        return self._root.n_committed

    @property
    def n_waves(self) -> int:
        """Number of committed waves."""
        return self._root.n_waves

    @property
    def population(self) -> dict[str, NDArray[np.float64]]:
        """The whole ensemble: every column of the population, (n_switches,) float64, by its name."""
        return population_of(self._read, self._root)

    def records(self) -> dict[str, NDArray[Any]]:
        """Every value of the committed candidates, by name: (n_committed, …) each, copies."""
        return self._table.columns(self.n_committed, self._hyperparameters)

    def blocks_done(
        self, stage: str, blocks: Sequence[Block], proposals_digests: Sequence[int], *, check: bool = True
    ) -> list[bool]:
        """Say for each block whether it is stored, of candidates with these proposals.

        Parameters
        ----------
        stage : str
            Stage of the blocks.
        blocks : sequence of (int, int)
            (i_block, j_block) each.
        proposals_digests : sequence of int
            One a block, in order.
        check : bool
            Read and compare the data of every marked block: after a loss of power a marker may have reached the disk
            and its data not.

        Returns
        -------
        list of bool
        """
        done = []
        for (i, j), expected in zip(blocks, proposals_digests, strict=True):
            marker = self._blocks.marker(stage, i, j)
            here = int(marker[0]) == expected and bool((marker != 0).all())
            done.append(here and not (check and self._blocks.problems(stage, i, j, expected)))
        return done

    def markers(self, stage: str, blocks: Sequence[Block]) -> dict[Block, NDArray[np.uint64]]:
        """The markers of blocks as they are stored.

        Parameters
        ----------
        stage : str
            Stage of the blocks.
        blocks : sequence of (int, int)
            (i_block, j_block) each.

        Returns
        -------
        dict
            Block to (n_markers,) uint64; 0 throughout where there is none.
        """
        return {(i, j): self._blocks.marker(stage, i, j) for i, j in blocks}

    def read_assessed(
        self, stage: str, i_block: int, j_block: int, n_switches: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """What an assessment takes of a stored block.

        Parameters
        ----------
        stage : str
            Stage of the block.
        i_block, j_block : int
            Its row and column.
        n_switches : int, optional
            Of the candidates, where they use less than the stage's whole ensemble.

        Returns
        -------
        dict
            max_contact_speed, closed, status, settling, (candidates, switches) each; asked, (…, n_asked), where the
            campaign asks for further quantities.
        """
        columns = self.layout.stage(stage).switches(j_block)
        used = columns.stop - columns.start if n_switches is None else min(n_switches, columns.stop) - columns.start
        try:
            response = self._blocks.block(stage, "response", i_block, j_block)[:, :used]
        except (ValueError, RuntimeError, OSError) as e:
            raise DamageError(
                f"block ({i_block}, {j_block}) of stage {stage} in {self.path} cannot be read ({e}): "
                f"run `softclose verify {self.path} --repair`"
            ) from e
        speed, closed, status, settling, asked = assessed_of(response)
        found = {"max_contact_speed": speed, "closed": closed, "status": status, "settling": settling}
        return found | ({"asked": asked} if self.layout.asked else {})

    def by_hand(self) -> tuple[Changed, ...]:
        """What a person has changed, in order; of a change that was cut off nothing is left, or it is complete.

        Raises LockedError where the store is not this driver's any more, and DamageError.
        """
        self._lock.check()
        self._root = settled(self._files.inner, self.path, self._root)
        return read_by_hand(self.path, self._root, self.layout)

    def change_readings(
        self, candidate: int, row: Mapping[str, Any], response: NDArray[np.float64], change: Change
    ) -> Changed:
        """Put other readings of a candidate on record. What is committed of it stays as it is.

        Parameters
        ----------
        candidate : int
            Which one.
        row : mapping
            The fields of its record, as `commit` takes them.
        response : (n_switches, n_quantities) ndarray
            Its readings, as a block holds them.
        change : Change
            Kind, from which wave on it is seen, why and when.

        Returns
        -------
        Changed

        Raises
        ------
        LockedError
            Where the store is not this driver's any more; nothing is written then.
        """
        table = RecordTable(self.layout, 1)
        check_names(row, ASSESSED | {field.name for field in self.layout.results})
        set_result(table, 0, row, 0, 0)
        record = table.records[0, self.layout.n_proposal_fields + 1 :]
        said = {"failure": str(table.words[0, FAILURE])}
        return self._change(candidate, change, said, readings_arrays(self.layout, record, response))

    def choose_waveform(self, candidate: int, rows: NDArray[np.float64], change: Change) -> Changed:
        """Put on record that a waveform is applied in the place of what is proposed as a candidate.

        Parameters
        ----------
        candidate : int
            Whose place it takes: none of which anything is stored.
        rows : (n_pulse, 4) ndarray
            start, rise, peak [µs] and volts.
        change : Change
            Why and when.

        Returns
        -------
        Changed

        Raises
        ------
        RecordError
            Where the layout cannot hold it.
        LockedError
            Where the store is not this driver's any more; nothing is written then.
        """
        check_waveform(self.layout, {"waveform": rows, "n_switches": 1, "origin": CHOSEN})
        return self._change(candidate, change, {}, waveform_arrays(rows))

    def _change(
        self, candidate: int, change: Change, said: Mapping[str, Any], arrays: Mapping[str, GroupArray]
    ) -> Changed:
        number = len(self.by_hand())
        write_group(self.path, name_of(number), arrays, {"candidate": candidate, **change.to_json(), **said})
        return self.by_hand()[number]

    def commit(self, rows: Sequence[Mapping[str, Any]], markers: Mapping[Block, NDArray[np.uint64]]) -> None:
        """Write the records of the next wave, then make it part of the campaign: the root's replacement is the commit.

        Parameters
        ----------
        rows : sequence of mapping
            One a candidate, in order from `n_committed` on: the proposal (waveform (n_pulse, 4), n_switches, origin,
            note, surrogate), the fields of the record and the timings; what is left out stays undefined.
        markers : mapping of block to (n_markers,) ndarray of uint64
            Those of all blocks of the wave, as `write_block` returned them or `markers` read them.

        Raises
        ------
        RecordError
            Where a row or a marker does not fit; then nothing changed.
        """
        start, stop = self.n_committed, self.n_committed + len(rows)
        tied = self._check_wave(start, rows, markers)
        self._lock.check()
        hyperparameters = list(self._hyperparameters)
        now = time.time()
        self._table.reserve(stop)
        try:
            for i, row in enumerate(rows, start):
                set_proposal(self._table, i, row, hyperparameters)
                set_result(self._table, i, row, self.n_waves, markers_digest(tied[i - start], i))
                set_timings(self._table, i, {"wall_committed_unix_s": now, **row})
        except RecordError:
            self._forget(start, stop)
            raise
        faults.point("before-record")
        if hyperparameters != self._hyperparameters:
            write_hyperparameters(self._arrays, self._files, hyperparameters)
            self._hyperparameters = hyperparameters
        write_rows(self._table, self._files, self._arrays, start, stop)
        faults.point("after-record")
        faults.point("before-commit")
        root = self._root.committed(stop, self.n_waves + 1, hyperparameters)
        write_root(self._files.inner, root)
        self._root = root
        faults.point("after-commit")

    def _check_wave(
        self, start: int, rows: Sequence[Mapping[str, Any]], markers: Mapping[Block, NDArray[np.uint64]]
    ) -> list[NDArray[np.uint64]]:
        """For each row the markers of its candidate's blocks; raises RecordError where they are not all there."""
        if not rows:
            raise RecordError("a wave has at least one candidate")
        for row in rows:
            check_names(row, PROPOSED | ASSESSED | TIMED | {field.name for field in self.layout.results})
            check_waveform(self.layout, row)
        sizes = {n_switches_of(row) for row in rows}
        if len(sizes) > 1:
            raise RecordError(
                f"the candidates of a wave have {sorted(sizes)} switches; one wave has one number of them"
            )
        n_switches = sizes.pop()
        blocks = self.layout.wave_blocks(start, len(rows), n_switches)
        if set(blocks) != set(markers):
            lost = sorted(set(blocks) - set(markers))
            raise RecordError(
                f"the wave from candidate {start} on has blocks {blocks[0]} to {blocks[-1]}; markers of {lost} are "
                f"missing, those of {sorted(set(markers) - set(blocks))} belong to no block of it"
            )
        stage, local = self.layout.stage_of(start)
        tied = []
        for i in dict.fromkeys(i for i, _ in blocks):
            candidates = stage.candidates(i)
            own = rows[candidates.start - local : candidates.stop - local]
            expected = proposals_digest(
                [row["waveform"] for row in own],
                n_switches,
                start - local + candidates.start,
                [design_of(self.layout, row) for row in own] if self.layout.designs else None,
            )
            found = np.stack([np.asarray(markers[i, j], dtype=np.uint64) for k, j in blocks if k == i])
            if found.shape[1] != len(self.layout.marker_names) or (found == 0).any() or (found[:, 0] != expected).any():
                raise RecordError(
                    f"the blocks of candidates {start - local + candidates.start} to "
                    f"{start - local + candidates.stop - 1} are not stored, or of other proposals; compute them first"
                )
            tied += [found] * len(own)
        return tied

    def _forget(self, start: int, stop: int) -> None:
        empty = RecordTable(self.layout, stop - start)
        for spec in TABLES.values():
            getattr(self._table, spec.name)[start:stop] = getattr(empty, spec.name)[: stop - start]

    def note_run(self, runtime: Mapping[str, Any]) -> None:
        """Add who runs the campaign now, and where, to the group `runtime` (not part of the campaign's identity).

        Parameters
        ----------
        runtime : mapping
            Plain JSON values.
        """
        canonical_json(runtime)  # raises for what is no JSON
        self._note(self._root.noted(runtime))

    def amend_run(self, more: Mapping[str, Any]) -> None:
        """Add to what `note_run` said of this run, such as where its time went.

        Parameters
        ----------
        more : mapping
            Plain JSON values.

        Raises
        ------
        LockedError
            Where the store is not this driver's any more.
        """
        canonical_json(more)
        self._lock.check()  # a store that was deleted under the run stays deleted
        self._note(self._root.amended(more))

    def _note(self, root: Root) -> None:
        write_key(self._files.inner, RUNTIME_KEY, runtime_text(root))
        write_root(self._files.inner, root)
        self._root = root

    def _check_committed(self) -> None:
        """Compare all committed records with their digests, and the data of the last blocks with their markers."""
        check_metadata(self._read, self._root)
        self._table.check(self._read, self.n_committed)
        if self.n_committed:
            self._check_last_wave(self.n_committed - 1)

    def _check_last_wave(self, i_last: int) -> None:
        """The data of the last wave's blocks, from the last on, as far as the budget of bytes goes."""
        stage, local = self.layout.stage_of(i_last)
        wave = self._table.number(i_last, "wave")
        per_trajectory = sum(
            int(np.prod(rest)) * np.dtype(dtype).itemsize for rest, dtype in self.layout.block_arrays.values()
        )
        left = TAIL_BYTES
        for i in reversed(range(local // stage.block_candidates + 1)):
            first = self.layout.first(stage.name) + stage.candidates(i).start
            if self._table.number(first, "wave") != wave:
                return
            proposals, n_switches = self._table.block_proposals(stage, i)
            for j in reversed(range(stage.blocks_of(n_switches))):
                if left < 0:
                    return
                left -= per_trajectory * int(np.prod(stage.block_shape(i, j)))
                problems = self._blocks.problems(stage.name, i, j, proposals)
                if problems:
                    raise DamageError(
                        f"block ({i}, {j}) of stage {stage.name} in {self.path} is damaged ({problems[0]}): "
                        f"run `softclose verify {self.path} --repair`"
                    )
