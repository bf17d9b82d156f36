"""Published switches and closed forms held against Softclose: writes docs/explanation/validation.md.

python -P benchmarks/validation.py -o docs/explanation/validation.md
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import quad

from softclose import Losses, ReducedOrder, simulate
from softclose.switch.plate import pull_in_voltage
from softclose.switch.reduced_order import Capacitance, CompliantContact, Dielectric, Mode
from softclose.waveform import Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One figure of a published switch, and ours."""

    what: str
    kind: str
    """closed form, somebody's model, or measured."""
    published: float
    ours: float
    unit: str
    why: str = ""
    """Why ours is off, where it is."""

    @property
    def off(self) -> float:
        """Ours over theirs, less 1."""
        return self.ours / self.published - 1.0


def step(switch: list[float], volts: float, until_us: float, **settings: Any) -> Any:
    """Response of one switch to a step of a millionth of the horizon."""
    drive = Trace([0.0, 1e-6 * until_us, until_us], [0.0, volts, volts])
    return simulate([switch], drive, horizon_us=until_us, max_volts=math.inf, rtol=1e-10, **settings)


def closed_forms() -> Iterator[Row]:
    """An ideal plate: energy gives dynamic pull-in and closing times."""
    area, gap = 1e4, 2.0
    for share, travel in ((0.7, 1.4), (0.999, 1.998)):
        switch = [travel, gap, 40.0, 1.0]
        omega, limit = math.sqrt(1e-3 * 40.0), float(pull_in_voltage(switch, area))
        low, high = 0.8 * limit, limit
        while high - low > 1e-9 * limit:
            volts = 0.5 * (low + high)
            touched = step(switch, volts, 400.0, plate_area_um2=area).n_impacts[0] > 0
            low, high = (low, volts) if touched else (volts, high)
        yield Row(
            what=f"ideal plate, D/G = {share:g}: dynamic pull-in over static",
            kind="closed form",
            published=math.sqrt(27.0 / 32.0),
            ours=high / limit,
            unit="",
        )
        for over in (1.0, 1.2, 1.4, 3.0):
            v2 = 8.0 / 27.0 * over**2
            exact = quad(lambda s, v2=v2: 2.0 / math.sqrt(v2 / (1.0 - s * s) - s * s), 0.0, math.sqrt(share))[0] / omega
            found = step(switch, over * limit, 10.0 * exact, plate_area_um2=area)
            yield Row(
                what=f"ideal plate, D/G = {share:g}: closing time at {over:g} V_p",
                kind="closed form",
                published=exact,
                ours=float(found.first_contact_us[0]),
                unit="µs",
            )


def plate() -> Iterator[Row]:
    """Rahim and Younis (2016), table 1: a plate of 21 kHz and Q 25 on a soft contact of 61 kHz."""
    area, k, f = 10353.5, 42.0, 21.0
    mass = k / (2.0 * math.pi * f) ** 2 * 1e3
    switch = [2.6, 3.8, k, mass]
    stiffness = mass * 1e-3 * (2.0 * math.pi * 61.0) ** 2
    dashpot = 2.0 * 0.2 * mass * 2.0 * math.pi * 61.0
    contact = CompliantContact(stiffness_N_per_m=stiffness, exponent=1.0, dashpot_uN_s_per_m=dashpot)
    modes = ReducedOrder(mode=(Mode(frequency_kHz=f, quality_factor=25.0),), contact=contact)
    # Before the first contact only: this contact lets the plate through at that voltage.
    found = step(
        switch, 1.2 * float(pull_in_voltage(switch, area)), 20.95, plate_area_um2=area, modes=modes, max_impacts=1
    )
    yield Row(
        what="plate of 21 kHz, step at 1.2 U_pi: first contact",
        kind="somebody's model",
        published=20.9,
        ours=float(found.first_contact_us[0]),
        unit="µs",
    )
    yield Row(
        what="the same: contact speed",
        kind="somebody's model",
        published=33.2,
        ours=100.0 * float(found.max_contact_speed[0]),
        unit="cm/s",
    )


def cantilever() -> Iterator[Row]:
    """Van Caekenberghe (2012), ohmic: gold, 75 x 30 x 5 µm; Q that varies with the gap is told as one Q of 8.6."""
    area, switch = 300.0, [0.2, 0.6, 300.4, 0.0864]
    limit = float(pull_in_voltage(switch, area))
    one = Losses(quality_factor=8.6)
    slip = Losses(film_viscosity_uPa_s=18.45, film_length_um=75.0, film_width_um=30.0, film_mean_free_path_um=0.15)
    why_film = (
        "a film that moves as a whole over 75 × 30 µm: this beam bends, only its tip moves so far, and the paper's "
        "damping is a factor of x, not a film"
    )
    for over, t, v in ((1.2, 1.060, 32.8), (1.4, 0.863, 44.5)):
        for losses, said, why in ((one, "one Q of 8.6", ""), (slip, "film with slip", why_film)):
            found = step(switch, over * limit, 20.0, plate_area_um2=area, losses=losses)
            name = f"ohmic cantilever at {over:g} V_p, {said}"
            yield Row(
                what=f"{name}: closing time",
                kind="somebody's model",
                published=t,
                ours=float(found.first_contact_us[0]),
                unit="µs",
                why=why,
            )
            yield Row(
                what=f"{name}: contact speed",
                kind="somebody's model",
                published=v,
                ours=100.0 * float(found.max_contact_speed[0]),
                unit="cm/s",
                why=why,
            )


TRAVEL = np.linspace(-1.5, 4.9, 33)
FARADS = (
    531.966, 532.247, 533.469, 535.636, 538.765, 542.881, 548.019, 554.227, 561.562, 570.100, 579.928,
    591.154, 603.911, 618.354, 634.675, 653.102, 673.917, 697.461, 724.157, 754.533, 789.252, 829.160,
    875.355, 929.280, 992.874, 1068.808, 1160.856, 1274.532, 1418.231, 1605.385, 1858.913, 2221.407, 2782.044,
)  # fmt: skip


def actuator() -> Iterator[Row]:
    """Rauf and others (JMEMS 31(1), 2022): gap-closing actuator of 70 fingers, measured, mean of three devices."""
    switch = [4.63, 5.63, 10.33, 3.53]
    c = Capacitance(gap_um=5.63, travel_um=tuple(TRAVEL.round(3).tolist()), capacitance_fF=FARADS)
    modes = ReducedOrder(mode=(Mode(frequency_kHz=8.6127, quality_factor=2.979),), capacitance=c)
    film = Losses(film_viscosity_uPa_s=18.5, film_length_um=76.1, film_width_um=40.0, film_count=70.0)
    slip = Losses(
        film_viscosity_uPa_s=18.5,
        film_length_um=76.1,
        film_width_um=40.0,
        film_count=70.0,
        film_mean_free_path_um=0.065,
    )
    for losses, said in ((film, "film of 70 fingers"), (slip, "the same with slip")):
        for volts, t in zip(
            (20, 25, 30, 35, 40, 50, 60, 80), (90.9, 57.9, 43.2, 34.9, 29.4, 23.1, 18.6, 13.3), strict=True
        ):
            found = step(switch, volts, 400.0, modes=modes, losses=losses)
            why = "just above pull-in, where a volt decides; their own model is off by 27 %" if volts == 20 else ""
            yield Row(
                what=f"gap-closing actuator, {said}: closing time at {volts} V",
                kind="measured",
                published=t,
                ours=float(found.first_contact_us[0]),
                unit="µs",
                why=why,
            )
    x = np.linspace(0.0, 4.63, 4001)
    volts = np.sqrt(2.0 * 1e-3 * 10.33 * x / (1e-6 * c.slope_at(x)))
    yield Row(what="the same: pull-in", kind="measured", published=16.55, ours=float(volts.max()), unit="V",
              why="capacitance of the drawn fingers; the closing times above are late for the same reason")  # fmt: skip
    yield Row(what="the same: pull-out", kind="measured", published=8.0, ours=float(volts[-1]), unit="V",
              why="the fingers bend in contact, which one mode with a rigid contact does not")  # fmt: skip


def bridge() -> Iterator[Row]:
    """Van Caekenberghe (2012), capacitive: gold, fixed at both ends, 300 x 80 x 0.5 µm over 0.2 µm of nitride."""
    e, rho, nu, sigma = 78e9, 19.2e3, 0.44, 100e6
    w, t, length = 80e-6, 0.5e-6, 300e-6
    k = 32.0 * e * w * (t / length) ** 3 * 27.0 / 49.0 + 8.0 * sigma * (1.0 - nu) * w * t / length * 0.6
    cubic = math.pi**4 * e * w * t / (8.0 * length**3) * 1e-12 / k
    mass, area, gap, coat = 0.4 * rho * length * w * t * 1e9, 8000.0, 2.0, 0.2 / 7.6
    limit = float(pull_in_voltage([gap, gap + coat, k, mass], area))
    yield Row(what="capacitive bridge: V_p without stretching", kind="somebody's model", published=35.57, ours=limit,
              unit="V")  # fmt: skip
    layer = Dielectric(thickness_um=0.2, permittivity=7.6)
    frequency = math.sqrt(k / mass * 1e9) / (2e3 * math.pi)
    switch = [0.9999 * gap, gap, k, mass]
    bare = ReducedOrder(mode=(Mode(frequency_kHz=frequency),), dielectric=layer)
    found = step(switch, 1.4 * limit, 200.0, plate_area_um2=area, modes=bare)
    yield Row(what="the same at 1.4 V_p, neither gas nor stretching: closing time", kind="somebody's model",
              published=3.76, ours=float(found.first_contact_us[0]), unit="µs")  # fmt: skip
    full = ReducedOrder(mode=(Mode(frequency_kHz=frequency, cubic_per_um2=cubic),), dielectric=layer)
    film = Losses(film_viscosity_uPa_s=18.45, film_length_um=300.0, film_width_um=80.0, film_mean_free_path_um=0.15)
    rough = [gap - 0.05, gap, k, mass]
    found = step(rough, 1.4 * limit, 2000.0, plate_area_um2=area, modes=full, losses=film)
    yield Row(what="the same with gas that slips and stretching (50 nm of roughness)", kind="somebody's model",
              published=58.7, ours=float(found.first_contact_us[0]), unit="µs",
              why="a film that moves as a whole over 300 × 80 µm, where a beam moves in its middle; the paper's "
              "damping stays finite in contact, a film's does not, so that the last 50 nm are left out")  # fmt: skip


def rows() -> list[Row]:
    """Every published figure and ours."""
    return [row for case in (closed_forms, plate, cantilever, actuator, bridge) for row in case()]


HEAD = """# Held against others

Switches that are not our paper's, with their published figures, put into Softclose's own terms. *Closed form*: an
integral or a root of the equations. *Somebody's model*: another program's integration of equations that their authors
state. *Measured*: a device. Written by `python -P benchmarks/validation.py -o docs/explanation/validation.md`, and
tested.

| figure | kind | published | ours | off by | why |
| --- | --- | ---: | ---: | ---: | --- |
"""
FOOT = """
Sources: closed forms follow from the balance of energy; Rahim and Younis (2016), table 1; Van Caekenberghe, IEEE
Microwave Magazine 13(1), 2012; Rauf and others, JMEMS 31(1), 2022. Films: Bao and Yang (2007); slip: Veijola and others
(1995). That plate's contact, a spring of 61 kHz, lets it through at 1.2 U_pi: what Softclose says of it after its first
contact is the status "collapsed" ([ADR 093](../adr/093-what-ends-a-switch.md)).
"""


def page(found: list[Row]) -> str:
    """The page as Markdown."""
    lines = [
        f"| {r.what} | {r.kind} | {r.published:.5g} {r.unit} | {r.ours:.5g} {r.unit} "
        f"| {round(100.0 * r.off, 2) + 0.0:+.2f} % | {r.why} |"
        for r in found
    ]
    return HEAD + "\n".join(lines) + "\n" + FOOT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.parse_args().output.write_text(page(rows()), encoding="utf-8")


if __name__ == "__main__":
    main()
