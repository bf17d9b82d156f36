"""Owns `softclose calibrate`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from softclose_workflows.commands.options import columns_option


@click.command(
    epilog="\b\nExamples:\n  softclose calibrate measurements.csv -o mine.toml --figure mine.svg\n"
    "  softclose run current --set population.name=mine.toml --store runs/mine.zarr\n\n\b\n"
    "The table needs the columns G_um, D_um, T_um and pull_in_V (or G_um, D_um, pull_in_V and resonance_kHz), one "
    "device a line; separators, decimal sign and encoding are found."
)
@click.argument("measurements", metavar="CSV")
@click.option("-o", "--output", required=True, metavar="TOML", help="The population, as `softclose run` accepts it.")
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
    measurements: str,
    output: str,
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
    """Fit a population to device measurements: gap, travel, and thickness with pull-in voltage, or a resonance."""
    from softclose.datafiles import parsed_columns
    from softclose.population.calibrate import calibrate as fit
    from softclose.population.calibrate import write_calibration
    from softclose.population.measurements import NAMES, read_measurements
    from softclose_workflows.tell.console import wide_console, working
    from softclose_workflows.tell.outputs import check_file, whole_file
    from softclose_workflows.tell.plain import json_text

    theirs = parsed_columns(columns, NAMES)
    check_file(output, "-o", [".toml"])
    if figure:
        from softclose_workflows.figures.saving import check_figure

        check_figure(figure)
    devices = read_measurements(measurements, columns=theirs)
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
