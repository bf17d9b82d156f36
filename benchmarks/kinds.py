"""What each kind of switch and of drive costs: trajectories per second and core beside those of Eqs. 1-2 under pulses.

All in one run and in turns, on distinct switches of the current population, CPU time, median of the repeats, each with
the error of V that it makes against its twin at rtol 1e-12 on the first switches, and with the seconds of its first
call: compilation on a machine that has not met it, the cache's loading after that.

    python benchmarks/kinds.py [--switches 10000] [--repeats 7] [--checked 200]
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from dataclasses import replace
from importlib import resources
from typing import Any

import numpy as np

from softclose import Losses, Pulse, ReducedOrder, Waveform, load_population, read_reduced_order, simulate
from softclose.conditions.amplifier import AmplifierSection, deliver
from softclose.switch.plate import EPSILON_0
from softclose.switch.reduced_order import Capacitance, Dielectric, Mode
from softclose.waveform import AnyDrive, Delivered, Trace

WAVEFORMS = {
    "designed": Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)]),
    "hard": Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)]),
}


def fingers() -> ReducedOrder:
    """Plates with a stray field."""
    x = np.linspace(-3.6, 2.9, 33)
    fF = 1e9 * EPSILON_0 * 16700.0 / (3.7 - x) * (1.0 - 0.3 * x / 3.7) + 20.0 * x
    table = Capacitance(gap_um=3.7, travel_um=tuple(x.tolist()), capacitance_fF=tuple(fF.tolist()))
    return ReducedOrder(mode=(Mode(frequency_kHz=20.0),), capacitance=table)


def kinds(waveform: Waveform, n: int) -> dict[str, tuple[AnyDrive, dict[str, Any]]]:
    """Name -> drive and settings."""
    rng = np.random.default_rng(5)
    scales = {"drive_volts": rng.normal(1.0, 0.02, n), "drive_times": rng.normal(1.0, 0.02, n)}
    first = Delivered(command=waveform, bandwidth_kHz=50.0)
    second = Delivered(command=waveform, bandwidth_kHz=50.0, order=2)
    slow = AmplifierSection(slew_volts_per_us=25.0)
    both = replace(slow, bandwidth_kHz=50.0)
    clocked = AmplifierSection(resolution_us=0.1, resolution_volts=0.1, bandwidth_kHz=50.0)
    rough = AmplifierSection(resolution_us=0.05)
    record = Trace(np.arange(0.0, 350.1, 0.1), waveform.voltage(np.arange(0.0, 350.1, 0.1)))
    q = Losses(quality_factor=20.0)
    with resources.as_file(resources.files("softclose.presets") / "modes" / "plate.toml") as path:
        plate = read_reduced_order(path)
    bridge = ReducedOrder(
        mode=(Mode(frequency_kHz=20.0, cubic_per_um2=0.1),), dielectric=Dielectric(thickness_um=0.3, permittivity=3.9)
    )
    slips = Losses(film_viscosity_uPa_s=2.0, film_mean_free_path_um=0.065)
    closing = list(waveform.pulses)
    last = closing[-1]
    let_go = Pulse(last.start_us, last.rise_us, 150.0 - last.start_us - last.rise_us, last.volts)
    brake = Waveform([*closing[:-1], let_go, Pulse(150.0 + 30.0, 6.0, 4.0, 40.0)])
    return {
        "Eqs. 1-2, pulses": (waveform, {}),
        "each drive scaled (trim)": (waveform, scales),
        "Q 20": (waveform, {"losses": q}),
        "Q 2": (waveform, {"losses": Losses(quality_factor=2.0)}),
        "film of 0.2 µPa s": (waveform, {"losses": Losses(film_viscosity_uPa_s=0.2)}),
        "film of 2 µPa s": (waveform, {"losses": Losses(film_viscosity_uPa_s=2.0)}),
        "adhesion of 20 µN": (waveform, {"losses": Losses(adhesion_uN=20.0)}),
        "amplifier, 50 kHz, first order": (first, {}),
        "amplifier, 50 kHz, second order": (second, {}),
        "first order, each drive scaled": (first, scales),
        "second order, each drive scaled": (second, scales),
        "first order, Q 20": (first, {"losses": q}),
        "slew limit of 25 V/µs": (deliver(slow, waveform, 250.0), {}),
        "slew limit, 50 kHz": (deliver(both, waveform, 250.0), {}),
        "clock of 0.1 µs, steps of 0.1 V, 50 kHz": (deliver(clocked, waveform, 250.0), {}),
        "clock of 0.05 µs": (deliver(rough, waveform, 250.0), {}),
        "a record, a sample every 0.1 µs": (record, {}),
        "opening with a brake": (brake, {"horizon_us": 350.0}),
        "opening with a brake, Q 20": (brake, {"horizon_us": 350.0, "losses": q}),
        "stretching, on a dielectric": (waveform, {"modes": bridge}),
        "film of 2 µPa s that slips": (waveform, {"losses": slips}),
        "a table of 33 capacitances": (waveform, {"modes": fingers()}),
        "that table, film of 2 µPa s": (waveform, {"modes": fingers(), "losses": Losses(film_viscosity_uPa_s=2.0)}),
        "two modes": (waveform, {"modes": plate}),
        "two modes, film of 0.5 µPa s": (waveform, {"modes": plate, "losses": Losses(film_viscosity_uPa_s=0.5)}),
        "two modes, first order": (first, {"modes": plate}),
    }


def rows(settings: dict[str, Any], n: int) -> dict[str, Any]:
    """Settings of the first n switches."""
    return {k: v[:n] if isinstance(v, np.ndarray) else v for k, v in settings.items()}


def error_cm_s(drive: AnyDrive, settings: dict[str, Any], switches: Any) -> float:
    """Largest error of V against the twin [cm/s]; of scaled drives against the kernel at rtol 1e-12."""
    few = rows(settings, len(switches))
    twin = "taylor" if "drive_volts" in few else "rk"
    found = simulate(switches, drive, **few).max_contact_speed
    best = simulate(switches, drive, method=twin, rtol=1e-12, **few).max_contact_speed  # type: ignore[arg-type]
    assert (np.isnan(found) == np.isnan(best)).all()
    return 100.0 * float(np.nanmax(np.abs(found - best)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--checked", type=int, default=200)
    args = parser.parse_args()
    switches = load_population("current").sample(args.switches, seed=3)
    for name, waveform in WAVEFORMS.items():
        cases = kinds(waveform, args.switches)
        started: dict[str, float] = {}
        for kind, (drive, settings) in cases.items():
            begin = time.process_time()
            simulate(switches[:1], drive, **rows(settings, 1))
            started[kind] = time.process_time() - begin
        spent: dict[str, list[float]] = {kind: [] for kind in cases}
        for _ in range(args.repeats):
            for kind, (drive, settings) in cases.items():
                begin = time.process_time()
                simulate(switches, drive, **settings)
                spent[kind].append(time.process_time() - begin)
        print(f"\n{name}\n{'kind':42s}{'/s':>10s}{'of the first':>14s}{'error of V, cm/s':>18s}{'first call, s':>15s}")
        base = statistics.median(next(iter(spent.values())))
        for kind, (drive, settings) in cases.items():
            seconds = statistics.median(spent[kind])
            error = error_cm_s(drive, settings, switches[: args.checked])
            print(
                f"{kind:42s}{args.switches / seconds:10,.0f}{base / seconds:14.2f}{error:18.1e}{started[kind]:15.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
