"""Owns the TOML file that a campaign for one's own switch begins with: chosen for its lot, each choice explained."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softclose.device.device import Device
from softclose.device.told import mean_switch
from softclose.evaluate.chain import chain_of
from softclose.population import Population, load_population
from softclose.propose.plan import plan
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig, ConfigError, load_config
from softclose.switch.plate import resonance
from softclose.tables import parsed_tables

Thoroughness = Literal["try", "usual", "thorough"]

EFFORTS: dict[Thoroughness, tuple[int, int, int]] = {
    "try": (40, 256, 0),
    "usual": (100, 1024, 0),
    "thorough": (60, 8192, 7680),
}
"""Candidates of the search, its switches, waveforms that descents try on the prior (0: the default)."""

ROOM = 1.5
"""Largest voltage over the highest pull-in voltage of the lot: what lets a pulse outrun the stiffest switch."""
PERIODS = 6.0
"""Natural periods that are simulated at least, a little more than the published study's 250 µs for its switch."""
SPARE = 0.1
"""Part of the hold voltage that the switch which lets go first should have to spare."""
N_HELD = 10_000
"""Switches among which that one is looked for."""
RISE_OF_PERIOD = 0.25
"""A rise longer than this part of the period hardly acts as a pulse."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """What a person is asked."""

    name: str = "my switch"
    """A title."""
    population: str = "current"
    """A shipped population, or the path of a population file."""
    n_pulses: Literal[2, 3] = 2
    """Pulses of the waveform."""
    max_volts: float | None = None
    """What the amplifier can do [V]; None: a half more than the stiffest switch pulls in at."""
    min_rise_us: float = 4.0
    """Fastest edge that the amplifier and higher modes allow [µs]."""
    max_open: float = 0.02
    """Share of the switches that may stay open at most, above which a waveform is no result."""
    effort: Thoroughness = "usual"
    """try: a minute; usual: some minutes; thorough: the search of the shipped three-pulse preset."""


FILE = """#:schema ./softclose.schema.json
# A campaign for {name}, written by `softclose init`.
# Look first:  softclose run THIS_FILE --store runs/mine.zarr --dry-run
# Run it:      softclose run THIS_FILE --store runs/mine.zarr
# The reference of the configuration describes every key; `softclose init --schema` writes a schema for editors.

[campaign]
name = {name}
seed = 1 # another seed is another search: two that agree are worth more than one
budget = {budget} # candidates that the Gaussian process proposes, from a prior: the built-in model of this lot

[population]
# The lot. Its mean switch pulls in at {mean:.1f} V, the whole lot between {low:.1f} and {high:.1f} V.
# The natural period of the mean switch is {period:.1f} µs.
# Fit a population to your own devices with `softclose calibrate`.
name = {population}
n_switches = {n} # switches that each candidate is tried on
sampling = "replicated" # 16 independent scramblings: less noise than random draws, and intervals that hold

[model]
horizon_us = {horizon:g} # {periods:.0f} natural periods; a switch that is held in contact then counts as closed
restitution = 0.5 # part of its speed that a switch keeps at an impact; measure yours, it shifts every figure
quality_factor = 0.0 # damping of the switch in its gas; 0: none, which is the harder case

[model_error]
# By how much this model may be off for the whole lot (standard deviations): 0 designs for a model that is right, and
# stands on its edge. `softclose calibrate --of` says what it leaves on your devices.
force = 0.02 # relative error of the electrostatic force: 1 % of the pull-in voltage
time = 0.01 # relative error of the switches' times

[waveform]
space = {space} # the last pulse holds the switches closed
max_volts = {volts:g} # {room:.2f} times the highest pull-in voltage of the lot{enough}
min_rise_us = {rise:g} # fastest edge{slow}; keep it above the period of the second mode

[objective]
# g = v_u + c1 p_nc: softness, and what an open switch costs, which scales with the lot's speed under a plain step.
max_open = {most_open:g} # beyond this share left open, candidates rank by the share open and not by softness
warn_open = {most_open:g} # beyond this share left open, a warning is printed
# A low hold voltage is a soft one, which creep, charge and a sagging supply take away: softness is not to be bought
# with hold. Volts that 90 % of the switches are held above their release voltage, at least. So held, the one of
# {n_held:,} that lets go first, at {release:.1f} V, has {spare:.0f} % of the hold voltage to spare{sag}.
quantity_limits = {{ hold_margin = {margin:g} }}
"""

THOROUGH = """
[optimiser]
n_regions = 4 # trust regions of the process, one a basin of the prior

[prior] # the built-in model on few switches, from which the process starts
n_switches = 512
budget = {descents} # waveforms that descents try on it before the first candidate
polish = 1608 # the best basins again on all of its switches, then a polish
looks = 36 # waveforms tried on it for each candidate

[store]
n_times = 101 # instants of each trajectory that is kept
max_impacts = 32
"""

SPACE = {2: "two-pulse-full", 3: "three-pulse-full"}


def starting_file(start: Start) -> str:
    """The file as text. Raises what `load_config` raises where the answers do not go together."""
    lot = load_population(start.population)
    device = chain_of(load_config({"population": {"name": start.population}})).device
    summary = lot.summary()
    period = 1e3 / float(resonance(np.atleast_2d(mean_switch(lot, device)))[0])
    high = summary["U_pi_upper_V"]
    volts = start.max_volts if start.max_volts is not None else 5.0 * math.ceil(ROOM * high / 5.0)
    horizon = max(50.0, 10.0 * math.ceil(PERIODS * period / 10.0))
    budget, n, descents = EFFORTS[start.effort]
    release, margin = room_to_hold(lot, device, volts)
    text = (FILE + THOROUGH * bool(descents)).format(
        name=quoted(start.name),
        budget=budget,
        mean=summary["U_pi_mean_switch_V"],
        low=summary["U_pi_lower_V"],
        high=high,
        period=period,
        population=quoted(start.population),
        n=n,
        horizon=horizon,
        periods=horizon / period,
        space=quoted(SPACE[start.n_pulses]),
        volts=volts,
        room=volts / high,
        enough="" if volts > high else ": NOT enough to close all of it slowly",
        rise=start.min_rise_us,
        slow="" if start.min_rise_us <= RISE_OF_PERIOD * period else ", MORE than a quarter of the natural period",
        most_open=start.max_open,
        descents=descents,
        n_held=N_HELD,
        release=release,
        margin=margin,
        spare=max(100.0 * SPARE if release < (1.0 - SPARE) * volts else 100.0 * (1.0 - release / volts), 0.0),
        sag="" if release < (1.0 - SPARE) * volts else ", at max_volts, which is LITTLE",
    )
    load_config(parsed_tables(text, "the campaign file", ConfigError))
    return text


def room_to_hold(lot: Population, device: Device, max_volts: float) -> tuple[float, float]:
    """The highest release voltage of the lot, and the margin that leaves its switch `SPARE` of the hold voltage [V].

    The margin counts for 90 % of the switches, as a limit of the objective does; two digits of it, rounded down.
    """
    release = device.holding_voltage(lot.sample(N_HELD, seed=0))
    last = float(np.nanmax(release))
    margin = max(min(last / (1.0 - SPARE), max_volts) - float(np.nanquantile(release, 0.9)), 0.0)
    step = 10.0 ** (math.floor(math.log10(margin)) - 1) if margin else 1.0
    return last, step * math.floor(margin / step)


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)


def explained(config: CampaignConfig) -> list[str]:
    """What a campaign will do, a line each: its stages and waves, candidates and trajectories."""
    waves = plan(Problem(config))
    lines = []
    for stage in dict.fromkeys(w.stage for w in waves):
        of = [w for w in waves if w.stage == stage]
        n, largest, most = sum(w.size for w in of), max(w.size for w in of), max(w.n_switches for w in of)
        waves_of = f"{len(of):,} wave{'s' * (len(of) != 1)} of up to {largest:,}"
        lines.append(f"{stage}: {n:,} candidates in {waves_of}, on up to {most:,} switches")
    total = sum(w.size for w in waves)
    return [*lines, f"in all: {total:,} candidates, {n_trajectories(config):,} trajectories"]


def n_trajectories(config: CampaignConfig) -> int:
    """Trajectories of all waves, in every case in which a switch is tried."""
    return config.n_cases * sum(w.size * w.n_switches for w in plan(Problem(config)))
