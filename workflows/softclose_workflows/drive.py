"""Owns one run of the driver: create or open the store, start the executor, run the campaign, print its result."""

from __future__ import annotations

import contextlib
import sys

import click

from softclose.config import CampaignConfig
from softclose.spaces import SPACES
from softclose.waveform import FloatArray
from softclose_store import DriverStore, Layout, StoreError, create_campaign, open_campaign, store_state
from softclose_workflows.campaign import Campaign
from softclose_workflows.executors import Placement, open_executor
from softclose_workflows.progress import show_progress
from softclose_workflows.runtime import changes_since, runtime
from softclose_workflows.stopping import stop_on_signals
from softclose_workflows.tasks import times_us


def create_store(config: CampaignConfig, path: str) -> None:
    """Create the store of a campaign, or accept the one that is there if it holds this very campaign.

    Raises a StoreError where the store holds something else, and names what differs.
    """
    try:
        create_campaign(
            path,
            layout=_layout(config),
            config=config.to_dict(),
            fingerprint=config.fingerprint(),
            durable=config.store.durable,
            population=population_columns(config),
            runtime=runtime(),
            exist_ok=True,
        )
    except OSError as e:
        raise StoreError(f"no store can be created at {path}: {e.strerror or e}; give a writable path") from e


def population_columns(config: CampaignConfig) -> dict[str, FloatArray]:
    """The campaign's whole ensemble: columns D, G, E, T, K, M, (n_switches_max,) each."""
    population = config.build_population()
    n, seed, sampling = config.n_switches_max, config.campaign.seed, config.population.sampling
    parameters = population.sample_parameters(n, seed=seed, sampling=sampling)
    switches = population.sample(n, seed=seed, sampling=sampling)
    return {
        "D": parameters[:, 0],
        "G": parameters[:, 1],
        "E": parameters[:, 2],
        "T": parameters[:, 3],
        "K": switches[:, 2],
        "M": switches[:, 3],
    }


def _layout(config: CampaignConfig) -> Layout:
    n_pulses, _ = SPACES[config.waveform.space]
    longest = max([n_pulses, *(len(rows) for rows in config.waveform.initial)])
    return Layout(
        n_candidates=config.total_budget,
        n_switches=config.n_switches_max,
        chunk_switches=config.chunk_switches,
        times_us=times_us(config.model.horizon_us, config.store.n_times),
        max_impacts=config.store.max_impacts,
        n_pulses=longest,
        limits_cm_s=config.objective.limits_cm_s,
    )


def drive(
    path: str,
    placement: Placement,
    *,
    config: CampaignConfig | None = None,
    break_lock: bool = False,
    quiet: bool = False,
) -> None:
    """Run the campaign in the store to its end and print the result.

    config: create the store first where there is none. Nothing is written before the executor has started.
    """
    from softclose_workflows.result import print_result

    with stop_on_signals() as stop, contextlib.ExitStack() as stack:
        state = store_state(path)
        is_new = state.kind in ("absent", "unfinished")
        if config is not None and not is_new:
            create_store(config, path)  # refuses whatever is not this very campaign
        if not state.finished:
            executor = stack.enter_context(open_executor(placement))
            if config is not None and is_new:
                create_store(config, path)
            store = stack.enter_context(DriverStore(path, break_lock=break_lock))
            for change in changes_since(open_campaign(path).runtime):
                click.echo(f"note: {change}: bits of further candidates may differ from a run here alone", err=True)
            store.note_run(runtime() | {"workers": executor.n_workers})
            if executor.dashboard and not quiet:
                click.echo(f"Dask dashboard: {executor.dashboard}", err=True)
            listener = stack.enter_context(show_progress(quiet=quiet or not sys.stderr.isatty()))
            Campaign(store, executor, stop=stop, listener=listener).run()
    print_result(path)
