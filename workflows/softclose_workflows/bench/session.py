"""Owns ask and tell: a campaign whose responses are measured, with a real generator and a vibrometer in its loop.

What is told is stored as what is simulated is: the same store, records, intervals and certificates. Every measurement
is on the disk when `tell` returns.
"""

from __future__ import annotations

import os
import time
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
from softclose.waveform import Waveform, WaveformError
from softclose_store import Best, Campaign, Change, DriverStore, open_campaign, path_text, store_state, write_block
from softclose_store.read.by_hand import ChangeKind
from softclose_workflows.analyses.certificates import write_certificate
from softclose_workflows.analyses.certification import Certification, Request, assemble, assess_fresh, candidate_name
from softclose_workflows.analyses.certify import check_size
from softclose_workflows.bench.readings import judged, nothing_read, scale_of
from softclose_workflows.errors import BenchError
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.flight import judged_record
from softclose_workflows.run.measurements import AwaitedBlocks, settle
from softclose_workflows.run.records import failed_record
from softclose_workflows.run.runtime import runtime
from softclose_workflows.run.tasks import PLACE, BlockResult, BlockTask

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
        waveform: Waveform | ArrayLike | None = None,
        reason: str = "",
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
        waveform
            What was applied in place of what `ask` gave, where you chose it by hand: a Waveform, or rows of start,
            rise, peak [µs] and volts. It takes the candidate's place, its origin and engine are `by-hand`, and the
            engine learns from it.
        reason
            Why it was chosen, for the record.

        Raises
        ------
        BenchError
            Where the candidate is not the one asked for, the numbers do not fit, the waveform is not admissible, or
            the bench is closed.
        LockedError
            Where another driver has taken the store over. Nothing is written then, nor for a BenchError.
        Stopped
            Where it is stored and its wave could not be committed (a full disk): the next `ask`, or opening the
            store again, commits it.
        """
        task = self._next()
        if candidate != task.first:
            raise BenchError(f"candidate {candidate} is told, but {task.first} was asked for: tell that one")
        rows = None if waveform is None else self._admissible(waveform)
        measured = judged(speeds_cm_s, closed, status, task.stop - task.start, self._scale(unusual))
        self._is_whole = False
        if rows is not None and not np.array_equal(rows, np.array(task.waveforms[0])):
            self._store.choose_waveform(candidate, rows, self._change("waveform", reason))
            task = self._next()
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

    def correct(
        self,
        candidate: int,
        speeds_cm_s: ArrayLike,
        closed: ArrayLike | None = None,
        *,
        status: ArrayLike | None = None,
        reason: str,
        unusual: bool = False,
    ) -> Assessment:
        """Put other readings of a candidate on record in place of those that were told; returns their assessment.

        What was told stays in the store as it is. The correction is a record of its own, from which everything that
        reads the store takes what counts; proposals see it from the next one on that is not made yet.

        Parameters
        ----------
        candidate
            One that was told.
        speeds_cm_s, closed, status
            As `tell` takes them, of all devices.
        reason
            Why, for the record.
        unusual
            As `tell` takes it.

        Raises
        ------
        BenchError
            Where nothing was told of the candidate, no reason is given, or as `tell` does.
        LockedError
            Where another driver has taken the store over.
        """
        n = len(self._told(candidate, reason).status)
        measured = judged(speeds_cm_s, closed, status, n, self._scale(unusual))
        self._change_readings(candidate, measured, "correction", reason)
        return assess_fresh(measured, self.config)

    def withdraw(self, candidate: int, devices: Iterable[int] | None = None, *, reason: str) -> Assessment | None:
        """Withdraw readings of a candidate, on record: they count as missing. What was told stays as it is.

        Parameters
        ----------
        candidate
            One that was told.
        devices
            Their places in the order of devices, from 0; by default all. A candidate of which all are withdrawn counts
            as failed.
        reason
            Why, for the record.

        Returns
        -------
        Assessment or None
            Of the readings that are left; None where there are none.

        Raises
        ------
        BenchError
            As `correct` does, and for a device that there is not.
        LockedError
            Where another driver has taken the store over.
        """
        before = self._told(candidate, reason)
        n = len(before.status)
        if devices is None:
            self._change_readings(candidate, nothing_read(n), "withdrawal", reason)
            return None
        gone = np.array(list(devices))
        if gone.size == 0 or gone.dtype.kind not in "iu" or not ((gone >= 0) & (gone < n)).all():
            raise BenchError(f"the devices are {gone.tolist()}; expected are places from 0 to {n - 1}")
        missing = before.status == MISSING
        missing[gone] = True
        if missing.all():
            return self.withdraw(candidate, reason=reason)
        measured = judged(
            np.ma.array(before.max_contact_speed * CM_S, mask=missing),
            before.closed,
            status=np.where(missing, 0, before.status),
            n=n,
            scale_cm_s=None,
        )
        self._change_readings(candidate, measured, "withdrawal", reason)
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
        measured = judged(speeds_cm_s, closed, None, n, self._scale(unusual))
        check_size(self.config, int((measured.status != MISSING).sum()), 1)
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
        found = assemble(campaign, self.config, waveforms, {name: measured}, request)
        write_certificate(self.path, found, None)
        return found

    def _begin(self) -> None:
        """Take up the campaign from what is stored."""
        self._measurements = AwaitedBlocks()
        self._driver = Driver(self._store, self._measurements)
        self._is_whole = True

    def _check_open(self) -> None:
        """Raise unless the store is this bench's: what another has committed meanwhile is not to be replaced."""
        if self._closed:
            raise BenchError(f"this bench of {self.path} is closed: open it again with Bench({self.path!r})")
        self._store.check_held()

    def _admissible(self, waveform: Waveform | ArrayLike) -> NDArray[np.float64]:
        """The rows of a waveform chosen by hand; raises BenchError where the campaign does not allow it."""
        config, n_most = self.config, self._store.layout.n_pulses
        try:
            chosen = waveform if isinstance(waveform, Waveform) else Waveform.from_rows(np.asarray(waveform, float))
            chosen.check(config.waveform.max_volts, config.model.horizon_us, config.waveform.least_rise_us)
        except (WaveformError, TypeError, ValueError) as e:
            raise BenchError(f"the waveform cannot be applied here: {e}") from e
        if len(chosen.pulses) > n_most:
            raise BenchError(f"the waveform has {len(chosen.pulses)} pulses; {self.path} holds up to {n_most}")
        return chosen.rows()

    def _told(self, candidate: int, reason: str) -> Judged:
        """The readings of a candidate that count; raises BenchError where it was not told, or no reason is given."""
        self._check_open()
        if not self._is_whole:
            self._begin()
            settle(self._driver)
            self._is_whole = True
        if not isinstance(reason, str) or not reason.strip():
            raise BenchError("readings are changed on record: say why (reason)")
        is_index = isinstance(candidate, int | np.integer) and not isinstance(candidate, bool)
        n = self._driver.n_told(int(candidate)) if is_index else 0
        if not n:
            raise BenchError(f"nothing was told of candidate {candidate!r}: tell it first")
        return self._readings_of(int(candidate), n)

    def _change(self, kind: ChangeKind, reason: str) -> Change:
        return Change(kind=kind, from_wave=self._driver.n_proposed, reason=reason, unix_s=time.time())

    def _readings_of(self, candidate: int, n: int) -> Judged:
        """The readings of a candidate that count, of n devices."""
        changed = [c.response for c in self._store.by_hand() if c.candidate == candidate and c.response is not None]
        if changed:
            response = changed[-1]
            return Judged(
                max_contact_speed=response[:, PLACE["max_contact_speed"]],
                closed=response[:, PLACE["closed"]] > 0.0,
                status=response[:, PLACE["status"]].astype(np.int8),
            )
        stage, local = self._store.layout.stage_of(candidate)
        row, at = divmod(local, stage.block_candidates)
        blocks = [self._store.read_assessed(stage.name, row, j, n) for j in range(stage.blocks_of(n))]
        return Judged(
            max_contact_speed=np.concatenate([block["max_contact_speed"][at] for block in blocks]),
            closed=np.concatenate([block["closed"][at] for block in blocks]).astype(np.bool_),
            status=np.concatenate([block["status"][at] for block in blocks]).astype(np.int8),
        )

    def _change_readings(self, candidate: int, measured: Judged, kind: ChangeKind, reason: str) -> None:
        """Write a change, and take the campaign up again with it."""
        self._is_whole = False
        if (measured.status == MISSING).all():
            row = failed_record(f"withdrawn: {reason}")
        else:
            row = judged_record(self.config, measured)
        response = self._arrays(measured)["response"][0]
        self._store.change_readings(int(candidate), row, response, self._change(kind, reason))

    def _scale(self, unusual: bool) -> float | None:
        return None if unusual else scale_of(self._store)

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
