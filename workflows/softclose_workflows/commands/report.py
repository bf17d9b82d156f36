"""Owns `softclose report`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import crew_options

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose report runs/a.zarr\n  softclose report runs/a.zarr -o for-colleagues.html"
)
@click.argument("store", metavar="STORE")
@click.option("-o", "--output", metavar="FILE", help="Where to write it [the store's name with .html, in this folder].")
@crew_options
@click.option("--quiet", "-q", is_flag=True, help="Say nothing but what went wrong.")
def report(store: str, output: str | None, placement: Placement, quiet: bool) -> None:
    """Write one self-contained HTML page about the campaign in STORE, also while it is being written.

    The page needs no network: its figures, data and scripts are inside. It can be mailed, archived and printed.
    """
    from softclose_workflows.report.gather import gather
    from softclose_workflows.report.page import render_report
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.outputs import check_file, default_name, say_written, write_text
    from softclose_workflows.terminal import working

    path = output or default_name(store, ".html")
    check_file(path)
    with working("reading the store", quiet=quiet), open_crew(placement) as crew:
        data = gather(store, mapper=crew)
    with working("drawing", quiet=quiet):
        page = render_report(data)
    write_text(path, page)
    if not quiet:
        say_written([path])
