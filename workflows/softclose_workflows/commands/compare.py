"""Owns `softclose compare`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose compare runs/two.zarr runs/three.zarr\n"
    "  softclose compare runs/*.zarr --fresh 20000 -o comparison.html\n"
    "  softclose compare runs/two.zarr runs/three.zarr --json | jq '.campaigns[].best.v_u_cm_s'"
)
@click.argument("stores", metavar="STORE STORE...", nargs=-1)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="Also write waveforms and contact speeds over each other: a page (.html) or a figure (.png, .svg, .pdf).",
)
@click.option(
    "--fresh",
    type=click.IntRange(min=1),
    metavar="N",
    help="Judge all on N new switches, the same ones where populations are the same.",
)
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def compare(
    stores: tuple[str, ...],
    output: str | None,
    fresh: int | None,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compare the best designs of two or more campaigns side by side.

    A certified campaign is judged on its new switches, any other on the switches that it was trained on; with --fresh
    all are judged alike, and differences are taken switch by switch.
    """
    from softclose_workflows.report.comparison import comparison_to_json, read_entries
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.outputs import check_file, say_written, write_text
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import working

    page = output is not None and output.lower().endswith((".html", ".htm"))
    if output is not None:
        check_file(output, "-o", [".html", ".htm", ".png", ".svg", ".pdf"])
    with working("reading the stores", quiet=quiet), open_crew(placement) as crew:
        entries = read_entries(stores, fresh or 0, crew)
    if output is not None:
        with working("drawing", quiet=quiet):
            if page:
                from softclose_workflows.report.compare_page import render_comparison

                write_text(output, render_comparison(entries))
            else:
                from softclose_workflows.figures.comparing import draw_comparison
                from softclose_workflows.figures.saving import save
                from softclose_workflows.figures.style import style

                with style():
                    save(draw_comparison(entries), output, "-o")
    if as_json:
        click.echo(json_text(comparison_to_json(entries)))
        return
    from softclose_workflows.report.compare_table import print_comparison

    print_comparison(entries)
    if output is not None and not quiet:
        say_written([output])
