"""Owns `softclose populations`."""

from __future__ import annotations

import click

PRINTED: dict[str, dict[str, tuple[float, ...]]] = {
    "current": {"D/G": (0.59, 0.75), "E[K]": (65.3,), "E[M]": (3.41,), "E[D]": (2.43,), "E[G]": (3.68,)},
    "modified": {"D/G": (0.41, 0.52)},
    "paper-text": {"D/G": (0.59, 0.75), "E[K]": (65.3,), "E[M]": (3.41,), "E[D]": (2.43,), "E[G]": (3.68,)},
}
"""What the published study prints of each population."""


@click.command(epilog="\b\nExamples:\n  softclose populations\n  softclose populations mine.toml current --json")
@click.argument("names", nargs=-1, metavar="[NAME|TOML]...")
@click.option("--plate-area", type=float, help="Plate area [µm²], for pull-in [that of the fit, else 16700].")
@click.option(
    "--modes",
    type=click.Path(dir_okay=False),
    help="TOML file of a reduced-order model: pull-in voltages are those of that model, not Eq. 3.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def populations(names: tuple[str, ...], plate_area: float | None, modes: str | None, as_json: bool) -> None:
    """Describe populations: ranges, means and pull-in voltages, beside what the published study prints of them."""
    from softclose.device.told import closing_summary
    from softclose.population import UNITS, load_population, population_names
    from softclose.switch.reduced_order import read_reduced_order
    from softclose_workflows.tell.console import wide_console
    from softclose_workflows.tell.plain import json_text

    loaded = {name: load_population(name) for name in names or population_names()}
    summaries = {name: p.summary(plate_area) for name, p in loaded.items()}
    if modes is not None:
        model = read_reduced_order(modes)
        for name, population in loaded.items():
            summaries[name] |= closing_summary(population, model, population.plate_area(plate_area))
    if as_json:
        click.echo(json_text(summaries))
        return
    from rich.table import Table

    table = Table(title="populations (printed figures in brackets)", title_justify="left")
    table.add_column("")
    for name in summaries:
        table.add_column(name, justify="right", no_wrap=True)

    def row(label: str, cells: list[str], printed: str = "") -> None:
        marks = [PRINTED.get(name, {}).get(printed, ()) for name in summaries]
        table.add_row(
            label,
            *(f"{c} [{'–'.join(f'{m:g}' for m in mark)}]" if mark else c for c, mark in zip(cells, marks, strict=True)),
        )

    for variable in dict.fromkeys(v for p in loaded.values() for v in p.variables):
        if variable in ("K", "M"):
            continue  # every lot has those, below
        unit = UNITS[variable]
        digits = 3 if unit == "µm" else 2
        keys = {what: f"{variable}_{what}_{unit.replace('µ', 'u')}" for what in ("lower", "mean", "upper")}
        has = [keys["mean"] in s for s in summaries.values()]
        row(
            f"{variable} [{unit}]",
            [
                f"{s[keys['lower']]:.{digits}f}–{s[keys['upper']]:.{digits}f}" if known else "–"
                for s, known in zip(summaries.values(), has, strict=True)
            ],
        )
        row(
            f"  mean {variable}",
            [
                f"{s[keys['mean']]:.{digits}f}" if known else "–"
                for s, known in zip(summaries.values(), has, strict=True)
            ],
            f"E[{variable}]",
        )
    row("D/G", [f"{s['D_over_G_lower']:.3f}–{s['D_over_G_upper']:.3f}" for s in summaries.values()], "D/G")
    for name, unit, printed in (("K", "N_per_m", "E[K]"), ("M", "ug", "E[M]")):
        label = {"K": "K [N/m]", "M": "M [µg]"}[name]
        row(label, [f"{s[f'{name}_lower_{unit}']:.2f}–{s[f'{name}_upper_{unit}']:.2f}" for s in summaries.values()])
        row(f"  mean {name}", [f"{s[f'{name}_mean_{unit}']:.3f}" for s in summaries.values()], printed)
        row(f"  sd {name}", [f"{s[f'{name}_sd_{unit}']:.3f}" for s in summaries.values()])
    row("U_pi [V]", [f"{s['U_pi_lower_V']:.1f}–{s['U_pi_upper_V']:.1f}" for s in summaries.values()])
    row("  mean switch", [f"{s['U_pi_mean_switch_V']:.2f}" for s in summaries.values()])
    wide_console().print(table)
