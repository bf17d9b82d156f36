"""Owns `softclose calibrate`: a population from a lot's statics, or a switch and its model from dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import click

from softclose_workflows.commands.options import columns_option


@click.command(
    epilog="\b\nExamples:\n  softclose calibrate measurements.csv -o mine.toml --figure mine.svg\n"
    "  softclose run current --set population.name=mine.toml --store runs/mine.zarr\n"
    "  softclose calibrate closing.csv voltages.csv --of cantilever --fix K -o mine.toml\n\n\b\n"
    "The table needs the columns G_um, D_um, T_um and pull_in_V (or G_um, D_um,\n"
    "pull_in_V and resonance_kHz), one device a line; separators, decimal sign\nand encoding are found."
)
@click.argument("measurements", metavar="CSV...", nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="TOML",
    help="The population, as `softclose run` accepts it; with --of the campaign, its lot and its modes.",
)
@click.option(
    "--of",
    "campaign",
    metavar="PRESET|FILE",
    help="Fit this campaign's device model to dynamics: closing times, motion.",
)
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    metavar="NAME[=VALUE]",
    help="With --of: K, M, Q, film, force or restitution is known, by default as the campaign has it; repeatable.",
)
@click.option(
    "--error",
    "errors",
    multiple=True,
    metavar="KIND=X",
    help="With --of: relative error of a kind of reading, its weight: closing=0.02; repeatable.",
)
@click.option("--rise", type=float, default=0.0, help="With --of: rise of the steps that closed the switch [µs].")
@click.option(
    "--starts", type=click.IntRange(min=1), default=6, show_default=True, help="With --of: starts of the fit."
)
@columns_option("G_um=gap,D_um=travel")
@click.option("--name", help="Name of the population [that of the file].")
@click.option(
    "--bounds",
    "given",
    multiple=True,
    metavar="X=LOWER:UPPER",
    help="Bounds of D, G, E, T (or K, f, U_pi) known from the process; repeatable.",
)
@click.option("--plate-area", type=float, default=16_700.0, show_default=True, help="Plate area [µm²].")
@click.option("--bootstrap", type=int, default=500, show_default=True, help="Bootstrap samples.")
@click.option("--confidence", type=float, default=0.95, show_default=True, help="Confidence of the intervals.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the bootstrap.")
@click.option("--figure", metavar="FILE", help="Histograms and fitted densities (svg, png or pdf).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def calibrate(
    measurements: tuple[str, ...],
    output: str,
    campaign: str | None,
    fixed: tuple[str, ...],
    errors: tuple[str, ...],
    rise: float,
    starts: int,
    columns: str | None,
    name: str | None,
    given: tuple[str, ...],
    plate_area: float,
    bootstrap: int,
    confidence: float,
    seed: int,
    figure: str | None,
    as_json: bool,
) -> None:
    """Fit a population to device measurements, or with --of a campaign's device model to measured dynamics.

    A population follows from gap, travel, and thickness with pull-in voltage, or a resonance, of eight devices or more.
    Dynamics tell stiffness, mass, Q, film, force and restitution of one device or several, each with its interval; what
    the readings cannot tell apart is named.
    """
    from softclose.datafiles import parsed_columns
    from softclose.population.calibrate import calibrate as fit
    from softclose.population.calibrate import write_calibration
    from softclose.population.measurements import NAMES, read_measurements
    from softclose_workflows.tell.console import wide_console
    from softclose_workflows.tell.outputs import check_file, whole_file
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import working

    theirs = parsed_columns(columns, NAMES)
    check_file(output, "-o", [".toml"])
    if campaign is not None:
        _of_dynamics(
            measurements, output, campaign, theirs, (fixed, errors), rise, starts, confidence, seed, as_json=as_json
        )
        return
    if fixed or errors or len(measurements) > 1:
        raise click.UsageError("--fix, --error and several tables go with --of, the campaign whose model is fitted")
    if figure:
        from softclose_workflows.figures.saving import check_figure

        check_figure(figure)
    devices = read_measurements(measurements[0], columns=theirs)
    with working(f"fitting, {bootstrap} bootstrap samples of each variable", quiet=False):
        calibration = fit(
            devices,
            name=name or Path(output).stem,
            bounds=parsed_bounds(given),
            plate_area_um2=plate_area,
            n_bootstrap=bootstrap,
            confidence=confidence,
            seed=seed,
        )
    with whole_file(output) as partial:
        write_calibration(calibration, partial)
    if figure:
        from softclose_workflows.figures.calibration import draw_calibration
        from softclose_workflows.figures.saving import save
        from softclose_workflows.figures.style import style

        with style():
            save(draw_calibration(calibration), figure)
    if as_json:
        click.echo(json_text(calibration.to_dict()))
        return
    from rich.table import Table

    described = calibration.to_dict()
    table = Table(title=f"{output}: fitted to {described['n_devices']} devices", title_justify="left")
    for column in ("", "distribution", "number", f"value ({100.0 * confidence:g} % interval)", "Cramér–von Mises p"):
        table.add_column(column)
    for variable, row in described["fits"].items():
        dull = ("alpha", "beta") if row["kind"] == "uniform" else ("half_width",)
        numbers = {key: v for key, v in row.items() if isinstance(v, list) and key not in dull}
        for i, (key, (value, lower, upper)) in enumerate(numbers.items()):
            first = (f"{variable} [{row['unit']}]", row["kind"], f"{row['p_value']:.3f}") if i == 0 else ("", "", "")
            table.add_row(first[0], first[1], key, f"{value:.5g} ({lower:.5g}–{upper:.5g})", first[2])
    console = wide_console()
    console.print(devices.said)
    console.print(table)
    for note in calibration.notes:
        console.print(f"note: {note}")


def _of_dynamics(
    tables: tuple[str, ...],
    output: str,
    campaign: str,
    columns: Mapping[str, str],
    given: tuple[tuple[str, ...], tuple[str, ...]],
    rise_us: float,
    n_starts: int,
    confidence: float,
    seed: int,
    *,
    as_json: bool,
) -> None:
    from softclose.identify.least_squares import identify
    from softclose.identify.own_campaign import model_of, write_own_campaign
    from softclose.identify.readings import read_dynamics
    from softclose.settings import load_config
    from softclose_workflows.analyses.identified import identified_to_json, print_identified
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import READING, working

    fixed = {name: value for name, value in map(_named_number, given[0])}
    errors = {name: _stated(name, value) for name, value in map(_named_number, given[1])}
    dynamics = read_dynamics(tables, columns=columns).weighed(errors)
    with working(READING, quiet=False):
        config = load_config(campaign)
    begun = model_of(config, rise_us)
    with working(f"fitting, {n_starts} starts", quiet=False):
        found = identify(begun, dynamics, fixed=fixed, confidence=confidence, n_starts=n_starts, seed=seed)
    files = write_own_campaign(config, begun, found, output)
    if as_json:
        click.echo(json_text(identified_to_json(found, files)))
        return
    print_identified(found, files, dynamics.said)


def _named_number(text: str) -> tuple[str, float | None]:
    """`K=10.3`, or `K` alone."""
    name, sign, value = text.partition("=")
    try:
        return name.strip(), float(value) if sign else None
    except ValueError as e:
        raise click.UsageError(f"{text!r} is not of the form NAME=NUMBER") from e


def _stated(name: str, value: float | None) -> float:
    if value is None:
        raise click.UsageError(f"--error {name} lacks its number: --error {name}=0.02")
    return value


def parsed_bounds(given: Iterable[str]) -> dict[str, tuple[float, float]]:
    """`D=2.3:2.7` each. Raises MeasurementError."""
    return dict(map(_bounds, given))


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    from softclose.population.measurements import MeasurementError

    variable, _, both = text.partition("=")
    lower, _, upper = both.partition(":")
    try:
        return variable.strip(), (float(lower), float(upper))
    except ValueError as e:
        raise MeasurementError(f"--bounds {text!r} is not of the form D=2.3:2.7") from e
