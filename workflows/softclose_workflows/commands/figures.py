"""Owns `softclose figures`."""

from __future__ import annotations

import click

from softclose_workflows.commands.options import quiet_option

NAMES = (
    "response",
    "pulses",
    "histogram",
    "densities",
    "exceedance",
    "switches",
    "population",
    "convergence",
    "length-scales",
    "dependence",
    "dependence-pairs",
)
"""Written out here, since matplotlib would take longer to import than `--help` may; a test compares."""


@click.command(
    epilog="\b\nExamples:\n  softclose figures runs/a.zarr\n"
    "  softclose figures runs/a.zarr -o paper/figures --format pdf --only response --only densities"
)
@click.argument("store", metavar="STORE")
@click.option("-o", "--output", metavar="FOLDER", help="Where to write them [the store's name with -figures, here].")
@click.option(
    "--format", "formats", multiple=True, type=click.Choice(["png", "svg", "pdf"]), help="Only this format; repeatable."
)
@click.option(
    "--only",
    multiple=True,
    type=click.Choice(NAMES),
    metavar="FIGURE",
    help=f"Only this figure; repeatable: {', '.join(NAMES)}.",
)
@quiet_option
def figures(store: str, output: str | None, formats: tuple[str, ...], only: tuple[str, ...], quiet: bool) -> None:
    """Write the figures of the campaign in STORE for publication, as PNG (300 dpi), SVG and PDF."""
    from softclose_workflows.figures.saving import FORMATS
    from softclose_workflows.figures.writing import write_figures
    from softclose_workflows.report.gather import gather
    from softclose_workflows.tell.outputs import check_folder, default_name, say_written
    from softclose_workflows.terminal import working

    learned = not only or any(name.startswith("dependence") for name in only)
    folder = check_folder(output or default_name(store, "-figures"), "-o")
    with working("reading the store", quiet=quiet):
        data = gather(store, learned=learned, picks=False)
    with working("drawing", quiet=quiet):
        paths = list(write_figures(data, str(folder), formats or FORMATS, only))
    if not paths:
        click.echo("softclose: no candidate has a usable result yet, so there is nothing to draw", err=True)
    elif not quiet:
        say_written(paths)
