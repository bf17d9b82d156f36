"""Owns reading: a campaign as typed, lazy, read-only values, committed candidates only, also while a run writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from numpy.typing import NDArray

from softclose_store.errors import DamageError, StoreError
from softclose_store.files import StorePath, local_path, normalised, open_files
from softclose_store.layout import CANDIDATE_ARRAYS, POPULATION
from softclose_store.root import Root, read_root

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
    record: Mapping[str, Any]
    """Every per-candidate value stored for it, by name."""


class LazyRows:
    """Rows of one candidate's array, read when indexed: `x[10:20]`, `x[5, ::10]`, `x[...]`."""

    def __init__(self, array: zarr.Array[Any], i: int, n: int) -> None:
        self._array = array
        self._i = i
        self.shape: tuple[int, ...] = (n, *array.shape[2:])
        """(n_switches, …)."""
        self.dtype = array.dtype
        """Type of the elements."""

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, selection: Any) -> NDArray[Any]:
        first, *rest = selection if isinstance(selection, tuple) else (selection,)
        n = self.shape[0]
        if first is Ellipsis:
            first = slice(None)
        if isinstance(first, int | np.integer):
            if not -n <= first < n:
                raise IndexError(f"switch {first} is outside the {n} of this candidate")
            return self._read((int(first) % n, *rest))
        if isinstance(first, slice):
            start, stop, step = first.indices(n)
            if step < 0:
                return self._read((slice(0, n), *rest))[first]
            return self._read((slice(start, stop, step), *rest))
        rows = np.asarray(first)
        rows = np.flatnonzero(rows) if rows.dtype == bool else np.where(rows < 0, rows + n, rows)
        if rows.size and (rows.min() < 0 or rows.max() >= n):
            raise IndexError(f"switches {rows.min()} to {rows.max()} are not all among the {n} of this candidate")
        rest += [slice(None)] * (len(self.shape) - 1 - len(rest))
        return self._guard(lambda: self._array.oindex[(self._i, rows, *rest)])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[...], dtype=dtype)

    def _read(self, selection: tuple[Any, ...]) -> NDArray[Any]:
        return self._guard(lambda: self._array[(self._i, *selection)])

    def _guard(self, read: Any) -> NDArray[Any]:
        try:
            return np.asarray(read())
        except (ValueError, RuntimeError, OSError) as e:
            raise DamageError(
                f"{self._array.name} of candidate {self._i} cannot be read ({type(e).__name__}: {e}): "
                "run `softclose verify`"
            ) from e

    def __repr__(self) -> str:
        return f"LazyRows({self._array.name}[{self._i}], shape={self.shape}, dtype={self.dtype})"


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


class Campaign:
    """A read-only view of one store, as of the instant it was opened; `refresh` looks again."""

    def __init__(self, path: StorePath) -> None:
        self.path = normalised(path)
        self._files = open_files(path, read_only=True)
        self._root: Root
        self._group: zarr.Group
        self._records: dict[str, NDArray[Any]] = {}
        self.refresh()

    def refresh(self) -> None:
        """Look at the store again: sees what was committed since."""
        self._root = read_root(self._files, self.path)
        self._records = {}
        target: Any = self.path if local_path(self.path) is None else local_path(self.path)
        self._group = zarr.open_group(target, mode="r", use_consolidated=True)

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
    def schema_version(self) -> int:
        """Version of the store's schema."""
        return int(self._root.attributes["softclose_schema"])

    @property
    def budget(self) -> int:
        """Candidates of the whole campaign."""
        return int(self._root.attributes["layout"]["n_candidates"])

    @property
    def committed(self) -> int:
        """Committed candidates."""
        return self._root.n_committed

    n_committed = committed

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
        return np.empty(0) if "time" not in self._root.metadata else self._whole("time")

    def records(self) -> dict[str, NDArray[Any]]:
        """Every per-candidate array, by name, (committed, …) each."""
        if not self._records:
            self._records = {s.name: self._whole(s.name)[: self.committed] for s in CANDIDATE_ARRAYS}
        return self._records

    def _whole(self, name: str) -> NDArray[Any]:
        try:
            return np.asarray(self._array(name)[...])
        except (ValueError, RuntimeError, OSError) as e:
            raise DamageError(
                f"{name} of {self.path} cannot be read ({type(e).__name__}: {e}): run `softclose verify`"
            ) from e

    def _array(self, name: str) -> zarr.Array[Any]:
        array = self._group[name]
        assert isinstance(array, zarr.Array)
        return array

    def _check(self, i: int) -> int:
        if isinstance(i, bool) or not isinstance(i, int | np.integer) or not 0 <= i < self.committed:
            raise StoreError(f"candidate {i!r} is not committed; {self.path} has {self.committed}, counted from 0")
        return int(i)

    def best(self, n_switches: int | None = None) -> Best | None:
        """The candidate of smallest g, None where no candidate has one.

        Values of g from ensembles of different sizes do not compare (small ones flatter their optimum), so only
        candidates of n_switches switches count: by default the most that any candidate with a g has. Ties: the first.
        """
        records = self.records()
        usable = ~records["failed"] & np.isfinite(records["g_cm_s"])
        sizes = records["n_switches"]
        if n_switches is None:
            n_switches = int(sizes[usable].max()) if usable.any() else 0
        usable &= sizes == n_switches
        if not usable.any():
            return None
        i = int(np.argmin(np.where(usable, records["g_cm_s"], np.inf)))
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
        """(n_pulse, 4) float64: start, rise, peak [µs] (inf where it holds) and volts."""
        rows: FloatArray = self.records()["waveform"][self._check(i)]
        return rows[~np.isnan(rows).all(axis=1)]

    def history(self) -> pd.DataFrame | dict[str, NDArray[Any]]:
        """One row per committed candidate: a pandas table where pandas is installed, else a dictionary of columns.

        Columns are the per-candidate values; a waveform's are `pulse1_start_us` …, the surrogate's `surrogate.<name>`.
        """
        columns = _columns(self.records(), [float(v) for v in self._root.attributes["layout"]["limits_cm_s"]])
        try:
            import pandas
        except ImportError:
            return columns
        plain = {
            name: column.astype(object) if column.dtype.kind == "T" else column for name, column in columns.items()
        }
        return pandas.DataFrame(plain, index=pandas.RangeIndex(self.committed, name="candidate"))

    def trajectories(self, i: int) -> Trajectories:
        """x(t) and v(t) of candidate i: `trajectories(3).x[10:20]` reads twenty switches' worth at most."""
        self._check(i)
        if "x" not in self._root.metadata:
            raise StoreError(f"{self.path} keeps no trajectories (store.n_times)")
        return Trajectories(times_us=self.times_us, x=self._rows("x", i), v=self._rows("v", i))

    def _rows(self, name: str, i: int) -> LazyRows:
        return LazyRows(self._array(name), i, int(self.records()["n_switches"][i]))

    def responses(self, i: int) -> StoredResponses:
        """Per-switch results of candidate i."""
        self._check(i)
        has_impacts = "impact_time" in self._root.metadata
        scalars = {
            name: self._rows(name, i)[...]
            for name in ("max_contact_speed", "n_impacts", "final_x", "final_v", "closed", "status")
        }
        return StoredResponses(
            **scalars,
            first_contact_us=self._rows("first_contact", i)[...],
            settling_us=self._rows("settling", i)[...],
            impact_time_us=self._rows("impact_time", i) if has_impacts else None,
            impact_speed=self._rows("impact_speed", i) if has_impacts else None,
        )

    def population(self) -> dict[str, FloatArray]:
        """The whole ensemble: D, G [µm], E [GPa], T [µm], K [N/m], M [µg], (n_switches,) each."""
        return {name: self._whole(name) for name in POPULATION}

    def switches(self) -> FloatArray:
        """The whole ensemble as the simulator takes it: (n_switches, 4), columns D, G, K, M."""
        population = self.population()
        return np.column_stack([population[name] for name in ("D", "G", "K", "M")])

    def dataset(self) -> xr.Dataset:
        """The store as xarray sees it, lazily."""
        import xarray

        dataset: xr.Dataset = xarray.open_zarr(self.path, chunks=None)
        return dataset

    def __repr__(self) -> str:
        return f"Campaign({self.path!r}, {self.committed} of {self.budget} candidates)"


def _columns(records: Mapping[str, NDArray[Any]], limits: list[float]) -> dict[str, NDArray[Any]]:
    """Per-candidate arrays as flat columns."""
    columns: dict[str, NDArray[Any]] = {}
    for spec in CANDIDATE_ARRAYS:
        values = records[spec.name]
        if spec.dims == ("candidate",):
            columns[spec.name] = values
        elif spec.name == "waveform":
            for pulse in range(values.shape[1]):
                for k, name in enumerate(("start_us", "rise_us", "peak_us", "volts")):
                    columns[f"pulse{pulse + 1}_{name}"] = values[:, pulse, k]
        elif spec.dims == ("candidate", "limit"):
            for k, limit in enumerate(limits):
                columns[f"{spec.name}_{limit:g}"] = values[:, k]
    names, values = records["surrogate_name"], records["surrogate"]
    for name in sorted({str(n) for n in names.ravel()} - {""}):
        at = names == name
        columns[f"surrogate.{name}"] = np.where(at.any(axis=1), np.where(at, values, 0.0).sum(axis=1), np.nan)
    return columns


def open_campaign(path: StorePath) -> Campaign:
    """Open a store for reading. Runs nothing that the store contains; sees committed candidates only.

    Raises StoreMissingError, SchemaError (a newer schema) or DamageError.
    """
    return Campaign(path)
