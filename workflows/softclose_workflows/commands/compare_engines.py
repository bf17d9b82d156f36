"""Owns `softclose compare-engines`."""

from __future__ import annotations

import click


@click.command(
    "compare-engines",
    epilog="\b\nExamples:\n  softclose compare-engines current --engines skopt,sobol --seeds 11,12,13\n"
    "  softclose compare-engines current-three --engines skopt,cmaes --figure engines.svg --json",
)
@click.argument("source", metavar="PRESET|FILE")
@click.option("--engines", required=True, metavar="NAME,NAME", help="Engines to compare.")
@click.option("--seeds", default="1,2,3", show_default=True, metavar="N,N", help="Seeds of ensemble and engine.")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting; repeatable.")
@click.option(
    "--switches",
    type=click.IntRange(min=0),
    default=20_000,
    show_default=True,
    help="New switches on which each best waveform is certified; 0: none.",
)
@click.option("--figure", metavar="FILE", help="Best g against evaluations and against time (svg, png or pdf).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def compare_engines(
    source: str, engines: str, seeds: str, overrides: tuple[str, ...], switches: int, figure: str | None, as_json: bool
) -> None:
    """Run several engines on one problem from several seeds, in this process, without stores."""
    from softclose.plugins import ENGINES
    from softclose.settings import ConfigError, load_config
    from softclose_workflows.analyses.engines import compare, print_comparison, to_json
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import READING, working

    names = [name.strip() for name in engines.split(",") if name.strip()]
    for name in names:
        ENGINES.check(name)
    try:
        numbers = [int(seed) for seed in seeds.split(",")]
    except ValueError as e:
        raise ConfigError(f"--seeds {seeds!r} is not of the form 1,2,3") from e
    if figure:
        from softclose_workflows.figures.saving import check_figure

        check_figure(figure)
    with working(READING, quiet=as_json):
        config = load_config(source, overrides)
    results = compare(config, names, numbers, switches, quiet=as_json)
    if figure:
        from softclose_workflows.figures.engines import draw_engines
        from softclose_workflows.figures.saving import save
        from softclose_workflows.figures.style import style

        with style():
            save(draw_engines(results), figure)
    if as_json:
        click.echo(json_text(to_json(results)))
    else:
        print_comparison(results)
