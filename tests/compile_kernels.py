"""Compiles the kernels that the tests use, each once and on all cores, before the tests begin.

A kernel takes ten seconds or more; processes of tests that need the same one at the same time would each compile it.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from examples import is_whole
from small_campaigns import FINISHED, make_campaign
from softclose import Losses, Pulse, ReducedOrder, Waveform, simulate
from softclose.conditions.amplifier import AmplifierSection, deliver
from softclose.switch.reduced_order import Capacitance, Mode
from softclose.waveform import Delivered, Fitted, Trace

MEAN = np.array([[2.43, 3.68, 65.3, 3.41]])
PULSES = Waveform([Pulse(0.0, 4.0, math.inf, 50.0)])
DRIVES = {
    "pulses": PULSES,
    "low-pass": Delivered(command=PULSES, bandwidth_kHz=50.0),
    "samples": Fitted.of(Trace(np.linspace(0.0, 20.0, 21), np.linspace(0.0, 50.0, 21)), 0.1),
}
MODES = tuple(Mode(frequency_kHz=20.0 * (k + 1), electrode=0.8**k) for k in range(3))
CAPACITANCE = Capacitance(gap_um=3.68, polynomial_fF=(40.0, 11.0, 2.0), valid_um=(-3.0, 3.6))
LOSSES = {
    "none": {},
    "Q": {"losses": Losses(quality_factor=20.0)},
    "film": {"losses": Losses(film_viscosity_uPa_s=1.0)},
    "cubic": {"modes": ReducedOrder(mode=(Mode(frequency_kHz=20.0, cubic_per_um2=0.1),))},
    "table": {"modes": ReducedOrder(mode=MODES[:1], capacitance=CAPACITANCE)},
    "table, film": {
        "modes": ReducedOrder(mode=MODES[:1], capacitance=CAPACITANCE),
        "losses": Losses(film_viscosity_uPa_s=1.0),
    },
    "slip": {"losses": Losses(film_viscosity_uPa_s=1.0, film_mean_free_path_um=0.1)},
    "two modes": {"modes": ReducedOrder(mode=MODES[:2])},
    "two modes, film": {"modes": ReducedOrder(mode=MODES[:2]), "losses": Losses(film_viscosity_uPa_s=1.0)},
}
Work = Callable[[], object]


def a_campaign() -> None:
    """What a search compiles beside the switches."""
    with tempfile.TemporaryDirectory() as folder:
        make_campaign(Path(folder) / "a.zarr", *FINISHED)


def simulated(drive: str, settings: dict[str, Any]) -> None:
    """One switch for an instant, with every output."""
    simulate(MEAN, DRIVES[drive], horizon_us=20.0, times_us=[0.0], max_impacts=1, **settings)


def is_rare(drive: str, losses: str) -> bool:
    """Whether only `make long` simulates such a switch under such a drive."""
    is_usual = drive == "pulses" or losses == "none" or (drive, losses) == ("low-pass", "Q")
    return losses == "two modes, film" or not is_usual


def works() -> dict[str, Work]:
    """What has to be compiled, by its name; about as long in every second as in the others."""
    found: dict[str, Work] = {
        "pulses, none": partial(simulated, "pulses", {}),
        "a campaign": a_campaign,
    }
    found |= {
        f"{drive}, {name}": partial(simulated, drive, settings)
        for name, settings in LOSSES.items()
        for drive in DRIVES
        if is_whole() or not is_rare(drive, name)
    }
    found["a slew limit"] = partial(deliver, AmplifierSection(slew_volts_per_us=10.0), PULSES, 20.0)
    found["by Runge-Kutta"] = partial(simulated, "pulses", {"method": "rk"})
    for n in (1, 2, 3) if is_whole() else (1, 2):
        modes = {"method": "rk", "modes": ReducedOrder(mode=MODES[:n])}
        found[f"{n} modes by Runge-Kutta"] = partial(simulated, "pulses", modes)
    return found


FIRST = "pulses, none"
"""The kernel that a campaign calls: whoever ran one before it is there would compile it too."""
LONGEST = ("2 modes by Runge-Kutta", "1 modes by Runge-Kutta", "pulses, table, film", "pulses, slip", "pulses, table")
"""What takes longest, longest first: what is begun last is short, and no core is idle for long at the end."""


def in_order(names: Iterable[str]) -> list[str]:
    """What is compiled when: what others need first, then what takes longest, a campaign once it has its kernel."""
    rank = {name: k for k, name in enumerate((FIRST, *LONGEST))}
    return sorted(names, key=lambda name: (name == "a campaign", rank.get(name, len(rank))))


def work_off(names: Any) -> None:
    """Compile what is left on the list, one after another."""
    found = works()
    while (name := names.get()) is not None:
        begin = time.process_time()
        found[name]()
        seconds = time.process_time() - begin
        if seconds > 2.0:
            print(f"compiled: {name} in {seconds:.0f} s", flush=True)


def main() -> None:
    """Work off the list in as many processes as there are cores."""
    context = multiprocessing.get_context("spawn")
    n = os.cpu_count() or 1
    names = context.Queue()
    for name in [*in_order(works()), *[None] * n]:
        names.put(name)
    workers = [context.Process(target=work_off, args=(names,)) for _ in range(n)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert all(worker.exitcode == 0 for worker in workers), "a kernel does not compile"


if __name__ == "__main__":
    main()
