"""Owns reading: a campaign as typed, lazy, read-only values, committed candidates only, also while a run writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose_store.disk.files import StorePath, look_at, normalised, open_files
from softclose_store.errors import StoreError
from softclose_store.listing import found_groups
from softclose_store.read.amended import amended_stage, amended_tables
from softclose_store.read.arrays import described, layout_of, read_array, read_static
from softclose_store.read.by_hand import Changed, latest_readings, read_by_hand
from softclose_store.read.checked import CheckedBlocks
from softclose_store.read.described import DescribedFiles
from softclose_store.read.labelled import CheckedFiles
from softclose_store.read.metadata import age_problem
from softclose_store.read.rows import LazyRows
from softclose_store.read.table import RecordTable
from softclose_store.schema.fields import PARAMETERS, RESPONSE_QUANTITIES, limit_texts, unit_in
from softclose_store.schema.group_metadata import OWN, decode
from softclose_store.schema.hierarchy import HYPERPARAMETER, HYPERPARAMETER_UNIT, MARKER, TABLES
from softclose_store.schema.layout import CANDIDATES, POPULATION, Layout
from softclose_store.schema.opening import read_root
from softclose_store.schema.root import ROOT_KEY, Root

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best candidate so far."""

    candidate: int
    """Its index."""
    g_cm_s: float
    """Objective [cm/s]."""
    v_u_cm_s: float
    """Upper velocity [cm/s]; NaN where undefined."""
    mean_cm_s: float
    """Mean contact speed [cm/s]."""
    p_nc: float
    """Fraction not closed at the horizon."""
    n_switches: int
    """Switches that it was evaluated on."""
    waveform: FloatArray
    """(n_pulse, 4): start, rise, peak [µs] (inf where it holds) and volts."""
    record: Mapping[str, Any] = field(repr=False)
    """Every per-candidate value stored for it, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectories:
    """x(t) and v(t) of every switch of one candidate, read when indexed."""

    times_us: FloatArray
    """(n_times,) [µs]."""
    x: LazyRows
    """(n_switches, n_times) float32, travel [µm]."""
    v: LazyRows
    """(n_switches, n_times) float32, velocity [µm/µs]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredResponses:
    """Per-switch results of one candidate, (n_switches,) each; `softclose.assess` accepts it."""

    max_contact_speed: FloatArray
    """Largest contact speed [µm/µs]; NaN where it never touched."""
    first_contact_us: FloatArray
    """First contact [µs]; inf where never."""
    settling_us: FloatArray
    """Instant from which it is held [µs]; inf where it is not closed."""
    n_impacts: NDArray[np.int32]
    """Number of impacts."""
    final_x: FloatArray
    """Travel at the horizon [µm]."""
    final_v: FloatArray
    """Velocity at the horizon [µm/µs]."""
    closed: NDArray[np.bool_]
    """Held in contact at the horizon."""
    status: NDArray[np.int8]
    """0 where it was integrated; -1 where it was never simulated (a failed candidate)."""
    impact_time_us: LazyRows | None
    """(n_switches, max_impacts) [µs], NaN beyond the last; None where none are kept."""
    impact_speed: LazyRows | None
    """(n_switches, max_impacts) [µm/µs]."""
    asked: FloatArray | None = None
    """(n_switches, n_asked) further quantities, in the order of `layout.asked`; None where there are none."""


class Campaign:
    """A read-only view of one store, as of the instant it was opened; `refresh` looks again."""

    def __init__(self, path: StorePath) -> None:
        self.path = normalised(path)
        self._plain = open_files(path, read_only=True)
        self._root: Root
        self._files: DescribedFiles
        self._blocks: CheckedBlocks
        self._loaded: RecordTable | None
        self._by_hand: tuple[Changed, ...] | None
        self._records: dict[str, NDArray[Any]]
        self._statics: dict[str, NDArray[Any]]
        self.layout: Layout
        self.refresh()

    def refresh(self) -> None:
        """Look at the store again: sees what was committed since."""
        self._root = read_root(self._plain, self.path)
        self._files = described(self._plain, self._root, self.path)
        self.layout = layout_of(self._files, self._root)
        self._blocks = CheckedBlocks(self._files, self.layout, self._table)
        self._loaded = None
        self._by_hand = None
        self._records = {}
        self._statics = {}

    @property
    def config(self) -> dict[str, Any]:
        """The campaign's configuration."""
        config: dict[str, Any] = self._root.attributes["config"]
        return config

    @property
    def fingerprint(self) -> str:
        """sha256 of the configuration's canonical JSON."""
        return self._root.fingerprint

    @property
    def algorithm(self) -> str:
        """Version of the algorithms that the campaign was begun with: the other half of its identity."""
        return self._root.algorithm

    @property
    def schema_version(self) -> int:
        """Version of the store's schema."""
        return int(self._root.attributes["softclose_schema"])

    @property
    def budget(self) -> int:
        """Candidates of the whole campaign."""
        return self.layout.n_candidates

    @property
    def committed(self) -> int:
        """Committed candidates."""
        return self._root.n_committed

    n_committed = committed

    @property
    def n_waves(self) -> int:
        """Committed waves."""
        return self._root.n_waves

    @property
    def stages(self) -> dict[str, int]:
        """Committed candidates of each stage, by name, in order."""
        return {s.name: self.layout.committed_of(s, self.committed) for s in self.layout.stages}

    def stage_of(self, i: int) -> str:
        """Name of the stage that a candidate belongs to."""
        return self.layout.stage_of(i)[0].name

    @property
    def finished(self) -> bool:
        """True where every candidate is committed."""
        return self.committed == self.budget

    @property
    def runtime(self) -> dict[str, Any]:
        """Who ran the campaign, when, on what and with which versions."""
        attributes: dict[str, Any] = self._root.metadata["runtime"]["attributes"]
        return attributes

    @property
    def times_us(self) -> FloatArray:
        """Time grid of the trajectories [µs]; empty where none are stored."""
        return self.layout.times_us

    def records(self) -> dict[str, NDArray[Any]]:
        """Every value of the committed candidates, by name, (committed, …) each.

        waveform is (committed, n_pulses, 4) with rows of NaN for absent pulses, p_exceed and its intervals
        (committed, n_limits); what the surrogate predicted is called `surrogate.<name>`, NaN where it did not say.
        """
        if not self._records:
            table = self._table().amended(self.by_hand)
            self._records = table.columns(self.committed, self._root.attributes["hyperparameters"])
        return self._records

    def records_as_told(self) -> dict[str, NDArray[Any]]:
        """As `records`, without what was changed by hand: what was committed."""
        return self._table().columns(self.committed, self._root.attributes["hyperparameters"])

    @property
    def by_hand(self) -> tuple[Changed, ...]:
        """What a person has changed, in order: readings corrected or withdrawn, waveforms chosen by hand."""
        if self._by_hand is None:
            self._by_hand = read_by_hand(self.path, self._root, self.layout)
        return self._by_hand

    @property
    def amended(self) -> dict[int, Changed]:
        """The last change of the readings of each committed candidate that has one."""
        return {i: change for i, change in latest_readings(self.by_hand).items() if i < self.committed}

    def _table(self) -> RecordTable:
        """All rows of committed candidates, compared with their digests."""
        if self._loaded is None:
            table = RecordTable(self.layout)
            table.load(self._files, self.committed)
            table.check(self._files, self.committed)
            self._check_age(table)
            self._loaded = table
        return self._loaded

    def _check_age(self, table: RecordTable) -> None:
        """Raise DamageError where the root is of an earlier time than the tables, an old copy for instance."""
        known = table.waves_beyond(self._files, self.committed)
        if age_problem(self._plain, self._root, known):
            now = read_root(self._plain, self.path)  # a run may have gone on since this view was opened
            if what := age_problem(self._plain, now, known):
                raise self._files.damage(ROOT_KEY, what)

    def _static(self, name: str) -> NDArray[Any]:
        if name not in self._statics:
            self._statics[name] = read_static(self._files, self._root, name)
        return self._statics[name]

    def _check(self, i: int) -> int:
        if isinstance(i, bool) or not isinstance(i, int | np.integer) or not 0 <= i < self.committed:
            raise StoreError(f"candidate {i!r} is not committed; {self.path} has {self.committed}, counted from 0")
        return int(i)

    def best(self, n_switches: int | None = None, *, stage: str | None = None) -> Best | None:
        """The candidate of smallest g; of several, the first.

        Values of g from ensembles of different sizes do not compare (training scores on few switches are optimistic).

        Parameters
        ----------
        n_switches : int, optional
            Only candidates of so many switches count; by default the most that any candidate with a g has.
        stage : str, optional
            Only candidates of this stage.

        Returns
        -------
        Best or None
            None where no candidate has a g.
        """
        records = self.records()
        usable = ~records["failed"] & np.isfinite(records["rank_cm_s"])
        if stage is not None:
            first = self.layout.first(stage)
            indices = np.arange(self.committed)
            usable &= (indices >= first) & (indices < first + self.layout.stage(stage).n_candidates)
        sizes = records["n_switches"]
        if n_switches is None:
            n_switches = int(sizes[usable].max()) if usable.any() else 0
        usable &= sizes == n_switches
        if not usable.any():
            return None
        i = int(np.argmin(np.where(usable, records["rank_cm_s"], np.inf)))
        return Best(
            candidate=i,
            g_cm_s=float(records["g_cm_s"][i]),
            v_u_cm_s=float(records["v_u_cm_s"][i]),
            mean_cm_s=float(records["mean_cm_s"][i]),
            p_nc=float(records["p_nc"][i]),
            n_switches=int(sizes[i]),
            waveform=self.waveform(i),
            record={name: column[i] for name, column in records.items()},
        )

    def waveform(self, i: int) -> FloatArray:
        """The waveform of a candidate.

        Parameters
        ----------
        i : int
            Index of the candidate.

        Returns
        -------
        (n_pulse, 4) ndarray of float64
            start, rise, peak [µs] (inf where it holds) and volts.
        """
        rows: FloatArray = self.records()["waveform"][self._check(i)]
        return rows[~np.isnan(rows).all(axis=1)]

    def history(self) -> pd.DataFrame | dict[str, NDArray[Any]]:
        """One row per committed candidate: a pandas table where pandas is installed, else a dictionary of columns.

        Columns are the per-candidate values; a waveform's are `pulse1_start_us` …, the surrogate's `surrogate.<name>`.
        """
        columns = _columns(self.records(), limit_texts(self.layout.limits_cm_s))
        try:
            import pandas
        except ImportError:
            return columns
        plain = {
            name: column.astype(object) if column.dtype.kind == "T" else column for name, column in columns.items()
        }
        return pandas.DataFrame(plain, index=pandas.RangeIndex(self.committed, name="candidate"))

    def trajectories(self, i: int) -> Trajectories:
        """x(t) and v(t) of a candidate, read when they are indexed.

        Parameters
        ----------
        i : int
            Index of the candidate.

        Returns
        -------
        Trajectories
            `trajectories(3).x[10:20]` reads twenty switches' worth at most.
        """
        self._check(i)
        if not self.layout.times_us.size:
            raise StoreError(f"{self.path} keeps no trajectories (store.n_times)")
        return Trajectories(times_us=self.times_us, x=self._rows("x", i), v=self._rows("v", i))

    def _rows(self, name: str, i: int, column: int | None = None) -> LazyRows:
        stage, local = self.layout.stage_of(i)
        rest, dtype = self.layout.block_arrays[name]
        shape = (self._table().n_switches(i), *rest)
        return LazyRows(
            partial(self._blocks.take, stage.name, name, local), f"{name} of candidate {i}", shape, dtype, column
        )

    def responses(self, i: int) -> StoredResponses:
        """Per-switch results of a candidate.

        Parameters
        ----------
        i : int
            Index of the candidate.

        Returns
        -------
        StoredResponses
            (n_switches,) arrays.
        """
        self._check(i)
        change = self.amended.get(int(i))
        told = None if change is None else change.response
        response = self._rows("response", i)[...] if told is None else told
        columns = {field.name: response[:, k].copy() for k, field in enumerate(self.layout.quantities)}
        counts = {name: np.where(np.isnan(columns[name]), -1.0, columns[name]) for name in ("n_impacts", "status")}
        has_impacts = bool(self.layout.max_impacts)
        return StoredResponses(
            max_contact_speed=columns["max_contact_speed"],
            first_contact_us=columns["first_contact"],
            settling_us=columns["settling"],
            n_impacts=counts["n_impacts"].astype(np.int32),
            final_x=columns["final_x"],
            final_v=columns["final_v"],
            closed=columns["closed"] > 0,
            status=counts["status"].astype(np.int8),
            impact_time_us=self._rows("impact", i, 0) if has_impacts else None,
            impact_speed=self._rows("impact", i, 1) if has_impacts else None,
            asked=response[:, len(RESPONSE_QUANTITIES) :].copy() if self.layout.asked else None,
        )

    def population(self) -> dict[str, FloatArray]:
        """The whole ensemble: every column of the population, (n_switches,) each, by its name."""
        return {column.name: self._static(f"{POPULATION}/{column.name}").copy() for column in self.layout.columns}

    def switches(self) -> FloatArray:
        """The switches alone: (n_switches, 4), columns D, G, K, M."""
        population = self.population()
        return np.column_stack([population[name] for name in ("D", "G", "K", "M")])

    def dataset(self, stage: str | None = None) -> xr.Dataset:
        """The tables of candidates as xarray sees them, lazily.

        Parameters
        ----------
        stage : str, optional
            That stage's responses and trajectories instead.

        Returns
        -------
        xarray.Dataset
        """
        import xarray

        group = CANDIDATES if stage is None else self.layout.stage(stage).name
        dataset: xr.Dataset = xarray.open_zarr(self._labelled(), group=group, chunks=None)
        return self._amended(group, dataset)

    def _amended(self, group: str, dataset: xr.Dataset) -> xr.Dataset:
        """The dataset of a group, with what was changed by hand."""
        if not self.by_hand:
            return dataset
        if group == CANDIDATES:
            return amended_tables(dataset, self._table().amended(self.by_hand), self.committed)
        return amended_stage(dataset, self.amended)

    def datatree(self) -> xr.DataTree:
        """The whole store as xarray sees it, lazily: the tables, the population, each stage and each result group."""
        import xarray

        target: Any = self._labelled()  # xarray says too little of what it takes
        tree: xr.DataTree = xarray.open_datatree(target, engine="zarr", chunks=None)
        for group in (CANDIDATES, *self.stages) if self.by_hand else ():
            tree[group].dataset = self._amended(group, tree[group].to_dataset())
        return tree

    def _labelled(self) -> CheckedFiles:
        """The files of the campaign and of its result groups as they are now, listed in the root or not yet."""
        groups = found_groups(self._plain, self._root)
        for name in self._root.listed.keys() - groups.keys():
            raise self._files.damage(f"{name}/zarr.json", "is listed in the root, and not there, or damaged")
        files = described(self._plain, self._root.listing(groups), self.path)
        expected: dict[str, str] = {}
        for name, entry in groups.items():
            own = decode(look_at(self._plain, f"{name}/zarr.json"), name) if OWN in entry["attributes"] else None
            expected |= {f"{name}/{member}": digest for member, digest in (own.files if own else {}).items()}
        return CheckedFiles(files, self._check_chunk, expected)

    def _check_chunk(self, name: str, chunk: str) -> bool:
        """Whether a chunk is in use; raises DamageError where it is not what was written."""
        stage, _, last = name.rpartition("/")
        if name in TABLES:
            self._table()
        elif name in (HYPERPARAMETER, HYPERPARAMETER_UNIT):
            names = list(self._root.attributes["hyperparameters"])
            texts = names if name == HYPERPARAMETER else [unit_in(text) for text in names]
            if [str(text) for text in read_array(self._files, name)][: len(names)] != texts:
                raise self._files.damage(f"{name}/{chunk}", "is not what was written")
        elif last in self.layout.block_arrays or last == MARKER.name:
            i, j = (int(index) for index in chunk.split(".")[1:3])
            if j >= self._blocks.n_columns(stage, i):
                return False
            self._blocks.check(stage, last, i, j)
        else:
            self._static(name)
        return True

    def __repr__(self) -> str:
        return f"Campaign({self.path!r}, {self.committed} of {self.budget} candidates)"


def _columns(records: Mapping[str, NDArray[Any]], limits: list[str]) -> dict[str, NDArray[Any]]:
    """Records as flat columns, named as the table of records names them."""
    columns: dict[str, NDArray[Any]] = {}
    for name, values in records.items():
        if name == "waveform":
            for pulse in range(values.shape[1]):
                for k, parameter in enumerate(PARAMETERS):
                    columns[f"pulse{pulse + 1}_{parameter}"] = values[:, pulse, k]
        elif values.ndim == 2:
            for k, limit in enumerate(limits):
                columns[f"{name}_{limit}"] = values[:, k]
        else:
            columns[name] = values
    return columns


def open_campaign(path: StorePath) -> Campaign:
    """Open a store for reading. Runs nothing that the store contains; sees committed candidates only.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.

    Returns
    -------
    Campaign

    Raises
    ------
    StoreMissingError
        Where there is none.
    SchemaError
        For another schema.
    DamageError
        Where its root cannot be read.
    """
    return Campaign(path)
