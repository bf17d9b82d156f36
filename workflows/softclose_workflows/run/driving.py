"""Owns a whole run: open or create the store, run the campaign on an executor to its end, or say why it stopped."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click

from softclose import ALGORITHM
from softclose.device.protocol import measured
from softclose.plugins import MEASURED
from softclose.propose.ahead import load_ahead
from softclose.settings import CampaignConfig
from softclose_store import DamageError, DriverStore, StoreError, finish_extension, open_campaign, store_state, verify
from softclose_workflows.errors import Stopped, StoreGoneError, machine_faults
from softclose_workflows.run.actuations import Actuated, actuate_lot, are_kept, contacts_of, keep_actuations
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store, layout_of
from softclose_workflows.run.crew import Crew
from softclose_workflows.run.executors import Executor, Placement, open_executor
from softclose_workflows.run.executors.placement import prepare_to_open
from softclose_workflows.run.needs import announced, check_run
from softclose_workflows.run.opening import design_at_the_end
from softclose_workflows.run.progress import show_progress
from softclose_workflows.run.runtime import runtime, say_changes
from softclose_workflows.run.stopping import stop_on_signals
from softclose_workflows.terminal import STARTING, say, working


def drive(
    path: str,
    placement: Placement,
    *,
    config: CampaignConfig | None = None,
    break_lock: bool = False,
    quiet: bool = False,
) -> None:
    """Run the campaign in the store to its end.

    config: create the store first where there is none. Nothing is written before the executor has started.
    Raises Stopped where it ends earlier, also for a fault of the disk or of memory.
    """
    with machine_faults():
        _drive(path, placement, config=config, break_lock=break_lock, quiet=quiet)


def _drive(path: str, placement: Placement, *, config: CampaignConfig | None, break_lock: bool, quiet: bool) -> None:
    with stop_on_signals() as stop, contextlib.ExitStack() as stack:
        opened = functools.cache(lambda: stack.enter_context(open_executor(placement)))

        def reaching_the_store() -> Executor:
            executor = opened()
            executor.probe(path, open_campaign(path).fingerprint)
            return executor

        crew = Crew(reaching_the_store, stop)
        state = store_state(path)
        if state.finished and finish_extension(path, break_lock=break_lock):
            state = store_state(path)
        is_new = state.kind in ("absent", "unfinished")
        whole = config if config is not None else CampaignConfig.from_dict(open_campaign(path).config)
        if whole.model.name == MEASURED and not state.finished:
            measured()
        check_run(whole, placement, path, committed=state.n_committed)
        if is_new and not quiet:
            say(announced(whole), err=True)
        if config is not None and not is_new:
            create_store(config, path)  # refuses whatever is not this very campaign
        if not state.finished:
            if config is None:
                whole.check_plugins()
            with working(STARTING, quiet=quiet), _loading(whole, placement):
                executor = opened()
            made: list[Actuated] = []
            if config is not None and is_new:
                if are_kept(config):
                    executor.probe("", "")
                    made = actuate_lot(config, mapper=Crew(opened, stop))
                create_store(config, path, contacts_of(made))
            store = stack.enter_context(DriverStore(path, expected_algorithm=ALGORITHM, break_lock=break_lock))
            _check_sizes(store, whole, path)
            say_changes(open_campaign(path).runtime)
            store.note_run(runtime() | {"workers": executor.n_workers})
            if executor.dashboard and not quiet:
                click.echo(f"Dask dashboard: {executor.dashboard}", err=True)
            listener = stack.enter_context(show_progress(quiet=quiet))
            with _still_there(path):
                keep_actuations(path, whole, mapper=crew, made=made)
                Driver(store, executor, stop=stop, listener=listener).run()
        else:
            _check_whole(path)
            keep_actuations(path, whole, mapper=crew)
        if whole.opening.is_designed:
            design_at_the_end(path, mapper=crew, quiet=quiet)


@contextlib.contextmanager
def _loading(config: CampaignConfig, placement: Placement) -> Iterator[None]:
    """Load meanwhile what proposals will need, where other processes start: they take as long."""

    def load() -> None:
        with contextlib.suppress(Exception):  # it is told where it is needed
            load_ahead(config)

    if placement.serial:
        yield
        return
    prepare_to_open(placement)
    thread = threading.Thread(target=load, name="softclose-loading", daemon=True)
    thread.start()
    yield
    thread.join()  # what is half imported would be met by the imports of the proposals


def _check_sizes(store: DriverStore, config: CampaignConfig, path: str) -> None:
    """Raise DamageError where a store has not the sizes that follow from its configuration."""
    said, follows = store.layout, layout_of(config)
    if replace(said, table_chunk=1).to_dict() != replace(follows, table_chunk=1).to_dict():
        raise DamageError(
            f"zarr.json of {path} says other sizes than follow from the configuration in it, {said.to_dict()} instead "
            f"of {follows.to_dict()}: it was made up, or by another version; run `softclose verify {path} --repair`"
        )


@contextlib.contextmanager
def _still_there(path: str) -> Iterator[None]:
    """Say of a failure that the store was taken away under the run, where it was."""
    try:
        yield
    except (Stopped, StoreError, OSError) as e:
        if "://" not in path and not Path(path, "zarr.json").exists():
            raise StoreGoneError(
                f"{path} is gone: it was renamed or deleted while this run worked on it; where it is now it holds what "
                f"was committed ({e})"
            ) from e
        raise


def _check_whole(path: str) -> None:
    """Raise DamageError where a finished store, which no driver opens any more, is damaged."""
    problems = verify(path).problems
    if problems:
        places = f"{len(problems)} places" if len(problems) > 1 else "one place"
        raise DamageError(
            f"{path} is finished and damaged in {places} ({problems[0]}): run `softclose verify {path} --repair`"
        )
