"""Owns ask and tell: a campaign whose responses are measured, with a real generator and a vibrometer in its loop.

What is told is stored as what is simulated is: the same store, records, intervals and certificates. Every measurement
is on the disk when `tell` returns.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose import ALGORITHM
from softclose.metrics.objective import CM_S, MISSING, Assessment, Judged
from softclose.plugins import ENGINES, MEASURED
from softclose.settings import CampaignConfig, load_config
from softclose.settings.overrides import texts
from softclose.waveform import Waveform
from softclose_store import Best, Campaign, DriverStore, open_campaign, path_text, store_state, write_block
from softclose_workflows.analyses.certificates import write_certificate
from softclose_workflows.analyses.certification import Certification, Request, assemble, assess_fresh, candidate_name
from softclose_workflows.analyses.certify import check_size
from softclose_workflows.errors import BenchError
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.measurements import Measurements, settle
from softclose_workflows.run.runtime import runtime
from softclose_workflows.run.tasks import PLACE, BlockResult, BlockTask
from softclose_workflows.terminal import say

SETTINGS = (
    f"model.name={MEASURED}",
    "optimiser.engine=skopt",
    "optimiser.n_initial=10",
    "optimiser.batch=1",
    "explore.budget=0",
    "finish.budget=0",
    "population.sampling=monte-carlo",
    "store.n_times=2",
    "store.max_impacts=1",
)
"""What a bench asks for on top of a preset: tens of waveforms on a handful of devices, a Gaussian process, one at a
time."""

BELOW, ABOVE = 40.0, 10.0
"""Median speeds below or above the lot's own by more than this are asked about: m/s taken for cm/s, and the like."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggestion:
    """A waveform to try."""

    candidate: int
    """Its index in the campaign."""
    waveform: Waveform
    """What the generator should give; `softclose export` writes its files."""
    n_devices: int
    """Devices to measure it on."""


class Bench:
    """A campaign on a test bench, open for its one driver. A context manager.

    Parameters
    ----------
    store
        Path or URL; created where there is none, continued otherwise. Opening commits what was told and, because of a
        kill or a full disk, not committed.
    source
        Preset, TOML file or configuration to create it from; its space, limits and population are those of the search.
        Not needed to continue; what is given then has to be what the store holds.
    devices, budget
        Devices that each waveform is measured on, and waveforms in all; of a new campaign.
    settings
        Further `section.key=value`, after `SETTINGS`.

    Raises
    ------
    BenchError
        Where the store holds a campaign that is simulated, or a new one lacks `source`, `devices` or `budget`.
    OtherConfigurationError
        Where the store was begun with other arguments than these; names what differs.
    ConfigError, StoreError
        As `load_config` and `DriverStore` do.
    """

    def __init__(
        self,
        store: str | os.PathLike[str],
        source: Any = None,
        *,
        devices: int | None = None,
        budget: int | None = None,
        settings: Iterable[str] = (),
    ) -> None:
        path, settings = path_text(store), tuple(texts(settings))
        if store_state(path).kind in ("absent", "unfinished"):
            if source is None or devices is None or budget is None:
                raise BenchError(f"{path} holds no campaign yet: give a preset, the number of devices and a budget")
            create_store(load_config(source, (*SETTINGS, *_own(devices, budget), *settings)), path)
            source, devices, budget, settings = None, None, None, ()
        config = CampaignConfig.from_dict(open_campaign(path).config)
        if config.model.name != MEASURED:
            raise BenchError(
                f"{path} holds a campaign of the device model {config.model.name}: what is measured needs a store of "
                "its own (waveform.initial_from begins with the best candidates of another one)"
            )
        _check_same(path, config, source, devices, budget, settings)
        ENGINES.check(config.optimiser.engine)
        self._closed = False
        self._store = DriverStore(path, expected_algorithm=ALGORITHM)
        try:
            self._store.note_run(runtime())
            self._begin()
            settle(self._driver)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the store back; what was told is in it. Nothing more is asked of this one or told to it."""
        self._closed = True
        self._store.close()

    @property
    def path(self) -> str:
        """Path or URL of the store."""
        return self._store.path

    @property
    def config(self) -> CampaignConfig:
        """The campaign's configuration."""
        return self._driver.config

    @property
    def finished(self) -> bool:
        """True where the whole budget is measured."""
        return self._store.n_committed == self.config.total_budget

    @property
    def best(self) -> Best | None:
        """The best candidate of the committed waves; None before the first usable one."""
        return open_campaign(self.path).best()

    @property
    def waveform(self) -> Waveform:
        """The best candidate's. Raises BenchError before the first usable one is committed."""
        return Waveform.from_rows(_best_of(open_campaign(self.path)).waveform)

    def ask(self) -> Suggestion:
        """The next waveform to measure: the same one until it is told.

        Raises
        ------
        BenchError
            Where the budget is spent, or the bench is closed.
        LockedError
            Where another driver has taken the store over.
        """
        task = self._next()
        return Suggestion(
            candidate=task.first, waveform=Waveform.from_rows(task.waveforms[0]), n_devices=task.stop - task.start
        )

    def tell(
        self,
        candidate: int,
        speeds_cm_s: ArrayLike,
        closed: ArrayLike | None = None,
        *,
        status: ArrayLike | None = None,
        unusual: bool = False,
    ) -> Assessment:
        """Store what was measured of the candidate that `ask` gave, and return its assessment (Eqs. 7-11).

        Parameters
        ----------
        candidate
            `Suggestion.candidate`.
        speeds_cm_s
            (n_devices,) largest impact speed of each device [cm/s], always in the same order of devices; NaN where it
            has none. Masked (`numpy.ma`, here or in the others): nothing was read, and the device is not counted.
        closed
            (n_devices,) whether it was held closed at the end. False and NaN: it never touched. True and NaN: closed,
            at a speed that is not known. By default, where it has a speed; NaN then counts as masked.
        status
            (n_devices,) 1 to 126 where the device failed; it counts as not closed.
        unusual
            Take speeds that are far from what the lot's own motion reaches; they are refused otherwise.

        Raises
        ------
        BenchError
            Where the candidate is not the one asked for, the numbers do not fit, or the bench is closed.
        LockedError
            Where another driver has taken the store over. Nothing is written then, nor for a BenchError.
        Stopped
            Where it is stored and its wave could not be committed (a full disk): the next `ask`, or opening the
            store again, commits it.
        """
        task = self._next()
        if candidate != task.first:
            raise BenchError(f"candidate {candidate} is told, but {task.first} was asked for: tell that one")
        measured = _judged(speeds_cm_s, closed, status, task.stop - task.start, self._scale(unusual))
        self._is_whole = False
        marker = write_block(
            task.store, task.stage, task.row, task.column, self._arrays(measured), task.proposals_digest
        )
        self._measurements.waiting.popleft()
        result = BlockResult(
            max_contact_speed=measured.max_contact_speed[np.newaxis],
            closed=measured.closed[np.newaxis],
            status=measured.status[np.newaxis],
            settling_us=np.full((1, measured.closed.size), np.nan),
            marker=marker,
            failures={},
            simulate_s=0.0,
            store_s=0.0,
        )
        self._measurements.told.append((task, result))
        self._driver.advance()
        self._is_whole = True
        return assess_fresh(measured, self.config)

    def certify(
        self,
        speeds_cm_s: ArrayLike,
        closed: ArrayLike | None = None,
        *,
        candidate: int | None = None,
        lot: int = 0,
        unusual: bool = False,
    ) -> Certification:
        """Certify a candidate by measurements of devices that the search never saw.

        It is kept in the store as any other certificate; `export`, `report` and `compare` follow it.

        Parameters
        ----------
        speeds_cm_s, closed : (n,) array-like
            As `tell` takes them.
        candidate : int, optional
            By default the best.
        lot : int
            Keeps certificates of equally many devices apart.
        unusual : bool
            As `tell` takes it.

        Raises
        ------
        CertifyError
            For too few devices.
        BenchError, LockedError
            Where the bench is closed, or another driver has taken the store over.
        """
        self._check_open()
        campaign = open_campaign(self.path)
        best = _best_of(campaign)
        index = best.candidate if candidate is None else candidate
        n = np.size(speeds_cm_s)
        judged = _judged(speeds_cm_s, closed, None, n, self._scale(unusual))
        check_size(self.config, int((judged.status != MISSING).sum()), 1)
        name = candidate_name(index)
        request = Request(
            n_switches=n,
            seed=lot,
            top=1,
            committed=campaign.committed,
            incumbent=best.candidate,
            candidates=(index,),
            missing={"unshaped": "nothing but the candidate was measured"},
        )
        waveforms = {name: Waveform.from_rows(campaign.waveform(index))}
        found = assemble(campaign, self.config, waveforms, {name: judged}, request)
        write_certificate(self.path, found, None)
        return found

    def _begin(self) -> None:
        """Take up the campaign from what is stored."""
        self._measurements = Measurements()
        self._driver = Driver(self._store, self._measurements)
        self._is_whole = True

    def _check_open(self) -> None:
        """Raise unless the store is this bench's: what another has committed meanwhile is not to be replaced."""
        if self._closed:
            raise BenchError(f"this bench of {self.path} is closed: open it again with Bench({self.path!r})")
        self._store.check_held()

    def _scale(self, unusual: bool) -> float | None:
        return None if unusual else _scale_of(self._store)

    def _next(self) -> BlockTask:
        self._check_open()
        if not self._is_whole:  # something was cut short: what of it is stored counts, and what is not is asked again
            self._begin()
        self._is_whole = False
        settle(self._driver)
        self._is_whole = True
        if not self._measurements.waiting:
            raise BenchError(
                f"all {self.config.total_budget} candidates of {self.path} are measured: extend it, or stop"
            )
        return self._measurements.waiting[0]

    def _arrays(self, measured: Judged) -> dict[str, NDArray[Any]]:
        layout, n = self._store.layout, measured.closed.size
        arrays: dict[str, NDArray[Any]] = {
            name: np.full((1, n, *rest), np.nan, dtype=dtype) for name, (rest, dtype) in layout.block_arrays.items()
        }
        response = arrays["response"][0]
        response[:, PLACE["max_contact_speed"]] = measured.max_contact_speed
        response[:, PLACE["closed"]] = measured.closed
        response[:, PLACE["status"]] = measured.status
        return arrays


def _own(devices: int | None, budget: int | None) -> tuple[str, ...]:
    """The settings that the arguments stand for."""
    own: tuple[str, ...] = ()
    if devices is not None:
        own += (f"population.n_switches={devices}", f"compute.block_switches={devices}")
    return own if budget is None else (*own, f"campaign.budget={budget}")


def _check_same(
    path: str, stored: CampaignConfig, source: Any, devices: int | None, budget: int | None, settings: tuple[str, ...]
) -> None:
    """Raise OtherConfigurationError, naming what differs, where the store holds another campaign than was asked for.

    What is not given is as stored. A limit that is lowered and not heeded would be a switch that is destroyed.
    """
    if source is not None:
        devices = stored.population.n_switches if devices is None else devices
        budget = stored.campaign.budget if budget is None else budget
        given = load_config(source, (*SETTINGS, *_own(devices, budget), *settings))
    elif devices is not None or budget is not None or settings:
        given = load_config(stored.to_dict(), (*_own(devices, budget), *settings))
    else:
        return
    create_store(given, path)


def _best_of(campaign: Campaign) -> Best:
    best = campaign.best()
    if best is None:
        raise BenchError(f"{campaign.path} has no usable candidate yet: tell some measurements first")
    return best


def _judged(
    speeds_cm_s: ArrayLike, closed: ArrayLike | None, status: ArrayLike | None, n: int, scale_cm_s: float | None
) -> Judged:
    """Readings as they are judged; scale_cm_s: what speeds are held against, None: nothing."""
    try:
        speeds = np.ma.asarray(speeds_cm_s, dtype=np.float64)
        given: Any = np.ma.asarray(~np.isnan(speeds.data) if closed is None else closed)
        outcome: Any = np.ma.asarray(np.zeros(n, dtype=np.int8) if status is None else status)
        if not (speeds.shape == given.shape == outcome.shape == (n,) and given.dtype == np.bool_):
            raise ValueError
        if outcome.dtype.kind not in "iub" or ((outcome.data < 0) | (outcome.data >= MISSING)).any():
            raise ValueError
        missing = np.ma.getmaskarray(speeds) | np.ma.getmaskarray(given) | np.ma.getmaskarray(outcome)
        lost = ~missing & (outcome.data != 0)
        unsaid = np.isnan(speeds.data) & ~missing & ~lost & (closed is None)
        missing |= unsaid
        speed = np.where(missing | lost, np.nan, speeds.data)
        held = np.asarray(given.data) & ~lost & ~missing
        known = ~np.isnan(speed)
        n_known, n_touched = int(known.sum()), int((known | held).sum())
        if missing.all() or np.isinf(speed).any() or (speed < 0.0).any() or 2 * n_known < n_touched:
            raise ValueError
    except (TypeError, ValueError, OverflowError) as e:
        raise BenchError(
            f"the measurements are {speeds_cm_s!r}, closed {closed!r}, status {status!r}; expected are {n} speeds of 0 "
            "cm/s or more, NaN where there is none, whether each is closed (True or False), a status from 0 to 126, "
            "each masked where nothing was read; at least one device has to be read, and at least half of those that "
            "touched need a speed"
        ) from e
    if n_known and scale_cm_s is not None:
        _check_scale(float(np.median(speed[known])), scale_cm_s)
    if unsaid.any():
        say(
            f"note: {unsaid.sum()} of {n} speeds are NaN and `closed` is not given: these readings count as "
            "missing; a device that stayed open is False in `closed`",
            err=True,
        )
    coded = np.where(missing, MISSING, np.where(lost, outcome.data, 0)).astype(np.int8)
    return Judged(max_contact_speed=speed / CM_S, closed=held, status=coded)


def _scale_of(store: DriverStore) -> float:
    """Median speed of the lot's own motion, travel times angular resonance D sqrt(K/M) [cm/s].

    A step of the full voltage closes the shipped lots at two to four times that, soft closings are at a tenth and more.
    """
    lot = store.population
    per_us = np.sqrt(lot["K"] / lot["M"] * 1e-3)  # N/m over µg is 1e9/s²
    return float(np.median(lot["D"] * per_us)) * CM_S


def _check_scale(median_cm_s: float, scale_cm_s: float) -> None:
    lower, upper = scale_cm_s / BELOW, scale_cm_s * ABOVE
    if not lower <= median_cm_s <= upper:
        raise BenchError(
            f"the median of the speeds is {median_cm_s:.3g} cm/s; devices of this lot close at some {lower:.2g} to "
            f"{upper:.2g} cm/s. Are the speeds in cm/s (1 m/s is 100 cm/s)? Where they are, say unusual=True"
        )
