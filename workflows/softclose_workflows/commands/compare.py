"""Owns `softclose compare`."""

from __future__ import annotations

import json

import click

from softclose_workflows.commands.options import quiet_option


@click.command(
    epilog="\b\nExamples:\n  softclose compare runs/two.zarr runs/three.zarr\n"
    "  softclose compare runs/*.zarr -o comparison.html\n"
    "  softclose compare runs/two.zarr runs/three.zarr --json | jq '.campaigns[].best.v_u_cm_s'"
)
@click.argument("stores", metavar="STORE STORE...", nargs=-1)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="Also write waveforms and contact speeds over each other: a page (.html) or a figure (.png, .svg, .pdf).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def compare(stores: tuple[str, ...], output: str | None, as_json: bool, quiet: bool) -> None:
    """Put the best designs of two or more campaigns side by side.

    A certified campaign is judged on its fresh switches, any other on the switches that it was trained on.
    """
    from softclose_workflows.report.comparison import comparison_to_json, read_entries
    from softclose_workflows.report.working import working

    with working("reading the stores", quiet=quiet):
        entries = read_entries(stores)
    if output is not None:
        from softclose_workflows.report.files import say_written, write_text

        with working("drawing", quiet=quiet):
            if output.lower().endswith((".html", ".htm")):
                from softclose_workflows.report.compare_page import render_comparison

                write_text(output, render_comparison(entries))
            else:
                from softclose_workflows.figures.comparing import write_comparison

                write_comparison(entries, output)
    if as_json:
        click.echo(json.dumps(comparison_to_json(entries), indent=2, allow_nan=False))
        return
    from softclose_workflows.report.compare_table import print_comparison

    print_comparison(entries)
    if output is not None and not quiet:
        say_written([output])
