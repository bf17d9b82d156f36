"""Owns the table that `softclose compare` prints."""

from __future__ import annotations

from collections.abc import Sequence

from softclose_workflows.analyses.certified_tables import comparison_line
from softclose_workflows.report.compare_page import table_rows
from softclose_workflows.report.comparison import Entry, differences, differing_settings, not_compared
from softclose_workflows.tell.console import wide_console


def print_comparison(entries: Sequence[Entry]) -> None:
    """One column a campaign; then what was set differently."""
    from rich.table import Table
    from rich.text import Text

    table = Table(show_lines=False)
    table.add_column("")
    for entry in entries:
        table.add_column(Text(entry.label), justify="right")  # Text: a name is not markup
    for name, values in table_rows(entries):
        table.add_row(name, *(Text(value) for value in values))
    settings = differing_settings(entries)
    if settings:
        table.add_section()
    for key, values in settings:
        table.add_row(key, *(Text(value) for value in values))
    console = wide_console()
    console.print(table)
    for label, first, difference in differences(entries):
        console.print(Text(f"{label} against {first}: {comparison_line(difference)}"))
    for line in not_compared(entries):
        console.print(Text(line))
    for entry in entries:
        for warning in entry.warnings:
            console.print(Text(f"{entry.label}: {warning}"))
