"""Owns the TOML form of a population: reading it (nominal values solved from printed means) and writing it.

A file gives D, G, E and T, or a `base` and what differs from it. See `shipped/` for the shipped ones.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path

from softclose.allowed.tables import checked
from softclose.naming import did_you_mean, unknown_key
from softclose.population.described import PopulationFile, Targets, around
from softclose.population.distributions import Bounded, PopulationError, portable
from softclose.population.formula import Formula
from softclose.population.laws import LAWS
from softclose.population.marginals import Empirical, Marginal, Truncated
from softclose.population.population import Population
from softclose.switch.plate import A1, mass, stiffness
from softclose.tables import at_home, parsed_tables, read_tables, toml_string

SHIPPED = ("current", "modified", "process-improved", "paper-text")
"""Names of the populations that come with the package."""


def load_population(source: str | Path) -> Population:
    """A shipped population by name (`population_names`), or one described by a TOML file.

    Parameters
    ----------
    source : str or Path
        Name or file.

    Returns
    -------
    Population

    Raises
    ------
    PopulationError
        For an unknown name, an unreadable file or an invalid description.
    """
    if isinstance(source, str) and source in SHIPPED:
        return _shipped(source)
    return read_population(source)


def population_names() -> tuple[str, ...]:
    """Names of the shipped populations."""
    return SHIPPED


@functools.cache
def _shipped(name: str) -> Population:
    return read_population(name)


def read_population(source: str | Path) -> Population:
    """Read a shipped population by name or a TOML file by path. Raises PopulationError, naming the file."""
    if not isinstance(source, str | Path):
        raise PopulationError(
            f"{source!r} is no population; give the path of a TOML file, or one of {', '.join(population_names())}"
        )
    return _read(source, ())


def _read(source: str | Path, seen: tuple[str, ...]) -> Population:
    if str(source) in SHIPPED:
        label, text = (
            str(source),
            (resources.files("softclose.population") / "shipped" / f"{source}.toml").read_text("utf-8"),
        )
        folder = None
    else:
        path = at_home(source)
        if path.suffix != ".toml" and not path.exists():
            raise PopulationError(
                f"no population is called {str(source)!r}; {did_you_mean(str(source), SHIPPED)}"
                f"known: {', '.join(SHIPPED)}, or give the path of a TOML file"
            )
        label, folder = str(path), path.parent
    if label in seen:
        raise PopulationError(f"{label}: populations are based on each other in a circle: {' -> '.join(seen)}")
    if folder is None:
        data = parsed_tables(text, label, PopulationError)
    else:
        data = read_tables(path, "the population file", PopulationError)
    try:
        file = checked(PopulationFile, data, PopulationError)
        base = None
        if file.base is not None:
            beside = folder is not None and file.base.endswith(".toml")
            base = _read(folder / file.base if beside and folder is not None else file.base, (*seen, label))
        return built(file, base)
    except PopulationError as e:
        raise PopulationError(f"{label}: {e}") from e


def built(file: PopulationFile, base: Population | None) -> Population:
    """The population of a file, on top of its base. Raises PopulationError where they do not go together."""
    known: dict[str, Marginal] = {} if base is None else dict(zip(base.variables, base.marginals(), strict=True))
    open_nominal: dict[str, float] = {}
    pair = _pair(file, base)
    known = {v: marginal for v, marginal in known.items() if v in ("D", "G", *pair)}
    for v in ("D", "G", *pair):
        described = file.variables.get(v)
        if described is None:
            if v not in known:
                raise PopulationError(f"[{v}] is missing; give D, G, E and T, or a base that has them")
            continue
        found = described.marginal()
        if isinstance(found, float):
            open_nominal[v] = found
        else:
            known[v] = found
    if open_nominal or file.targets is not None:
        _solve_nominals(known, open_nominal, file.targets or Targets())
    for v, change in file.transform.items():
        if v not in known:
            raise PopulationError(f"[transform] {unknown_key(v, known)}")
        # Eqs. 14 and 15 commute, so their order needs no rule.
        try:
            known[v] = known[v].shift_mean(change.shift_mean).scale_spread(change.repeatability)
        except PopulationError as e:
            raise PopulationError(f"[transform.{v}] {e}") from e
    inherited = base.correlation if base else ()
    correlation = tuple((a, b, rho) for a, b, rho in inherited if a in known and b in known)
    if file.correlation is not None:
        correlation = file.pairs()
        if "E" in open_nominal and any({a, b} == {"E", "T"} for a, b, _ in correlation):
            raise PopulationError(
                "targets.mean_K_N_per_m is solved for with E and T independent: give [E] a nominal beside a correlation"
            )
    formula = base.formula if base is not None and pair == ("E", "T") else None
    if file.law is not None:
        formula = Formula.of(file.law)
    if formula is not None and file.targets is not None:
        raise PopulationError("targets are solved for by Eqs. 4 and 6, and [law] replaces them: give nominals")
    return Population(
        name=file.name if file.name is not None else base.name if base else "unnamed",
        description=file.description if file.description is not None else base.description if base else "",
        plate_area_um2=file.plate_area_um2
        if file.plate_area_um2 is not None
        else base.plate_area_um2
        if base
        else None,
        correlation=correlation,
        formula=formula,
        **known,
    )


def _pair(file: PopulationFile, base: Population | None) -> tuple[str, str]:
    """The variables beside D and G: those of the file's own, else those of its base."""
    own = [v for v in file.variables if v not in ("D", "G")]
    fitting = [pair for pair in LAWS if all(v in pair for v in own)]
    inherited = base.law.variables if base is not None else ("E", "T")
    if not fitting:
        pairs = ", ".join(" and ".join(pair) for pair in LAWS)
        given = ", ".join(f"[{v}]" for v in own)
        raise PopulationError(f"{given} do not go together; beside D and G give one pair of {pairs}")
    return inherited if inherited in fitting else next((p for p in fitting if set(own) == set(p)), fitting[0])


def _solve_nominals(known: dict[str, Marginal], half_widths: Mapping[str, float], targets: Targets) -> None:
    """Find the nominal T and E at which E[M] and E[K] are the printed ones: M depends on T only, K is linear in E."""
    for v, key in (("T", "mean_M_ug"), ("E", "mean_K_N_per_m")):
        given = getattr(targets, key) is not None
        if v in half_widths and not given:
            raise PopulationError(f"[{v}] has no nominal; give it, or targets.{key} from which it follows")
        if given and v not in half_widths:
            raise PopulationError(f"targets.{key} is given, but [{v}] leaves no nominal to solve for: remove one")
    for v in half_widths:
        if v not in ("E", "T"):
            raise PopulationError(f"[{v}] has no nominal; only those of E and T can follow from targets")
    if "T" in half_widths and targets.mean_M_ug is not None:
        known["T"] = _thickness(half_widths["T"], targets.mean_M_ug)
    if "E" in half_widths and targets.mean_K_N_per_m is not None:
        per_modulus = known["T"].expect(lambda t: stiffness(1.0, t))
        known["E"] = around(portable(targets.mean_K_N_per_m / per_modulus), half_widths["E"])


@functools.cache
def _thickness(half: float, mean_mass_ug: float) -> Bounded:
    """Uniform T with E[M] as given. Bisection: M grows with T, and scipy.optimize would cost 0.2 s to import."""
    lo, hi = A1 / (1.0 - half), 100.0
    lightest, heaviest = around(lo, half).expect(mass), around(hi, half).expect(mass)
    if not lightest < mean_mass_ug < heaviest:
        raise PopulationError(
            f"targets.mean_M_ug is {mean_mass_ug:g}; with this half_width Eq. 6 gives {lightest:.3g} to "
            f"{heaviest:.3g} µg"
        )
    while hi - lo > 1e-14 * hi:
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if around(mid, half).expect(mass) < mean_mass_ug else (lo, mid)
    return around(portable(hi), half)


def write_population(population: Population, path: str | Path, comments: Iterable[str] = ()) -> None:
    """Write a file that `read_population` turns back into an equal population. comments: lines put at the top."""
    lines = [f"# {c}" if c else "#" for c in comments]
    lines += [f"name = {toml_string(population.name)}", f"description = {toml_string(population.description)}"]
    if population.plate_area_um2 is not None:
        lines.append(f"plate_area_um2 = {population.plate_area_um2!r}")
    for v, marginal in zip(population.variables, population.marginals(), strict=True):
        lines += ["", f"[{v}]", *_lines(marginal)]
    if population.correlation:
        lines += ["", "[correlation]", *(f"{a}-{b} = {rho!r}" for a, b, rho in population.correlation)]
    if population.formula is not None:
        table = population.formula.to_dict()
        told = (f"{name} = {toml_string(v) if isinstance(v, str) else repr(v)}" for name, v in table.items())
        lines += ["", "[law]", *told]
    Path(path).write_text("\n".join(lines) + "\n", "utf-8")


def _lines(b: Marginal) -> list[str]:
    """The table of one variable."""
    if isinstance(b, Empirical):
        return ['distribution = "empirical"', f"values = {list(b.values)!r}"]
    if isinstance(b, Truncated):
        given = {"location": b.location, "scale": b.scale, "lower": b.low, "upper": b.high}
        moved = {"offset": b.offset, "factor": b.factor} if (b.offset, b.factor) != (0.0, 1.0) else {}
        return [f'distribution = "{b.kind}"', *(f"{key} = {value!r}" for key, value in (given | moved).items())]
    if b.lower == b.upper:
        return ['distribution = "fixed"', f"value = {b.lower!r}"]
    lines = [f'distribution = "{"uniform" if b.is_uniform else "beta"}"', f"lower = {b.lower!r}"]
    lines.append(f"upper = {b.upper!r}")
    return lines if b.is_uniform else [*lines, f"alpha = {b.alpha!r}", f"beta = {b.beta!r}"]
