"""Owns the TOML form of a population: reading it (nominal values solved from printed means) and writing it.

A file gives D, G, E and T, or a `base` and what differs from it. See `shipped/` for the shipped ones.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from softclose.naming import did_you_mean
from softclose.population.copula import Correlation
from softclose.population.distributions import Bounded, PopulationError, portable
from softclose.population.formula import Formula
from softclose.population.laws import LAWS, UNITS
from softclose.population.marginals import Empirical, Marginal, Truncated
from softclose.population.population import Population
from softclose.switch.plate import A1, mass, stiffness
from softclose.tables import at_home, check_keys, finite_number, parsed_tables, read_tables, toml_string

SHIPPED = ("current", "modified", "process-improved", "paper-text")
"""Names of the populations that come with the package."""

_TOP = ("name", "description", "plate_area_um2", "base", *UNITS, "correlation", "law", "targets", "transform")
_TARGETS = ("mean_M_ug", "mean_K_N_per_m")
_TRANSFORMS = ("shift_mean", "repeatability")
_KEYS = {
    "beta": ("distribution", "lower", "upper", "mean", "shape_sum", "alpha", "beta"),
    "uniform": ("distribution", "lower", "upper", "nominal", "half_width"),
    "normal": ("distribution", "mean", "sd", "location", "scale", "lower", "upper", "offset", "factor"),
    "lognormal": ("distribution", "mean", "sd", "location", "scale", "lower", "upper", "offset", "factor"),
    "empirical": ("distribution", "values"),
    "fixed": ("distribution", "value"),
}
_PAPER_SHAPE_SUM = 4.0


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
        base = None
        if "base" in data:
            name = data["base"]
            if not isinstance(name, str):
                raise PopulationError(f"base is {name!r}; it must be the name of a population or a file's path")
            base = _read(folder / name if folder is not None and name.endswith(".toml") else name, (*seen, label))
        return _build(data, base)
    except PopulationError as e:
        raise PopulationError(f"{label}: {e}") from e


def _build(data: Mapping[str, Any], base: Population | None) -> Population:
    _known(data, _TOP, "")
    known: dict[str, Marginal] = {} if base is None else dict(zip(base.variables, base.marginals(), strict=True))
    open_nominal: dict[str, float] = {}
    pair = _pair(data, base)
    known = {v: marginal for v, marginal in known.items() if v in ("D", "G", *pair)}
    for v in ("D", "G", *pair):
        if v not in data:
            if v not in known:
                raise PopulationError(f"[{v}] is missing; give D, G, E and T, or a base that has them")
            continue
        parsed = _variable(v, _table(data, v))
        if isinstance(parsed, float):
            open_nominal[v] = parsed
        else:
            known[v] = parsed
    if open_nominal or "targets" in data:
        _solve_nominals(known, open_nominal, _table(data, "targets") if "targets" in data else {})
    transform = _table(data, "transform") if "transform" in data else {}
    _known(transform, known, "transform")
    for v in transform:
        change = _table(transform, v)
        _known(change, _TRANSFORMS, f"transform.{v}")
        # Eqs. 14 and 15 commute, so their order needs no rule.
        try:
            known[v] = known[v].shift_mean(_number(change, "shift_mean", 0.0))
            known[v] = known[v].scale_spread(_number(change, "repeatability", 1.0))
        except PopulationError as e:
            raise PopulationError(f"[transform.{v}] {e}") from e
    inherited = base.correlation if base else ()
    correlation = tuple((a, b, rho) for a, b, rho in inherited if a in known and b in known)
    if "correlation" in data:
        correlation = _correlation(_table(data, "correlation"))
        if "E" in open_nominal and any({a, b} == {"E", "T"} for a, b, _ in correlation):
            raise PopulationError(
                "targets.mean_K_N_per_m is solved for with E and T independent: give [E] a nominal beside a correlation"
            )
    formula = base.formula if base is not None and pair == ("E", "T") else None
    if "law" in data:
        formula = Formula.from_dict(_table(data, "law"))
    if formula is not None and "targets" in data:
        raise PopulationError("targets are solved for by Eqs. 4 and 6, and [law] replaces them: give nominals")
    name = data.get("name", base.name if base else "unnamed")
    description = data.get("description", base.description if base else "")
    area = _number(data, "plate_area_um2") if "plate_area_um2" in data else base.plate_area_um2 if base else None
    return Population(
        name=str(name),
        description=str(description),
        plate_area_um2=area,
        correlation=correlation,
        formula=formula,
        **known,
    )


def _pair(data: Mapping[str, Any], base: Population | None) -> tuple[str, str]:
    """The variables beside D and G: those of the file's own, else those of its base."""
    own = [v for v in UNITS if v in data and v not in ("D", "G")]
    fitting = [pair for pair in LAWS if all(v in pair for v in own)]
    inherited = base.law.variables if base is not None else ("E", "T")
    if not fitting:
        pairs = ", ".join(" and ".join(pair) for pair in LAWS)
        given = ", ".join(f"[{v}]" for v in own)
        raise PopulationError(f"{given} do not go together; beside D and G give one pair of {pairs}")
    return inherited if inherited in fitting else next((p for p in fitting if set(own) == set(p)), fitting[0])


def _correlation(table: Mapping[str, Any]) -> tuple[Correlation, ...]:
    """`E-T = 0.78` each."""
    found = []
    for key in table:
        a, dash, b = str(key).partition("-")
        if not (dash and a in UNITS and b in UNITS):
            raise PopulationError(
                f"[correlation] {key!r} is no pair of variables; write two of {', '.join(UNITS)}, as E-T = 0.78"
            )
        try:
            found.append((a, b, _number(table, key)))
        except PopulationError as e:
            raise PopulationError(f"[correlation] {e}") from e
    return tuple(found)


def _variable(v: str, table: Mapping[str, Any]) -> Marginal | float:
    """The distribution, or the relative half-width where the nominal value is left to the targets."""
    kind = table.get("distribution")
    if isinstance(kind, list | dict) or kind not in _KEYS:
        raise PopulationError(
            f"[{v}] distribution is {kind!r}; {did_you_mean(str(kind), _KEYS)}it must be one of {', '.join(_KEYS)}"
        )
    _known(table, _KEYS[kind], v)
    try:
        if kind == "fixed":
            value = _number(table, "value")
            return Bounded(lower=value, upper=value)
        if kind == "uniform":
            if "half_width" not in table:
                return Bounded(lower=_number(table, "lower"), upper=_number(table, "upper"))
            half = _number(table, "half_width")
            if not 0.0 <= half < 1.0:
                raise PopulationError(f"half_width is {half:g}; it is a fraction of the nominal, from 0 to below 1")
            if "lower" in table or "upper" in table:
                raise PopulationError("give either lower and upper, or nominal and half_width, not both")
            if "nominal" not in table:
                return half
            return _around(_number(table, "nominal"), half)
        if kind == "empirical":
            return Empirical(values=table.get("values", ()))
        lower, upper = _number(table, "lower"), _number(table, "upper")
        if kind in ("normal", "lognormal"):
            by_moments = "mean" in table or "sd" in table
            if by_moments == ("location" in table or "scale" in table):
                raise PopulationError("give either mean and sd, or location and scale, of the values before truncation")
            if by_moments:
                found = Truncated.from_moments(kind, _number(table, "mean"), _number(table, "sd"), lower, upper)
            else:
                place, scale = _number(table, "location"), _number(table, "scale")
                found = Truncated(kind=kind, location=place, scale=scale, low=lower, high=upper)
            return replace(found, offset=_number(table, "offset", 0.0), factor=_number(table, "factor", 1.0))
        if ("mean" in table) == ("alpha" in table or "beta" in table):
            raise PopulationError("give either mean (and shape_sum), or alpha and beta")
        if "mean" in table:
            shape_sum = _number(table, "shape_sum", _PAPER_SHAPE_SUM)
            return Bounded.from_mean(lower, upper, _number(table, "mean"), shape_sum)
        return Bounded(lower=lower, upper=upper, alpha=_number(table, "alpha"), beta=_number(table, "beta"))
    except PopulationError as e:
        raise PopulationError(f"[{v}] {e}") from e


def _solve_nominals(known: dict[str, Marginal], half_widths: Mapping[str, float], targets: Mapping[str, Any]) -> None:
    """Find the nominal T and E at which E[M] and E[K] are the printed ones: M depends on T only, K is linear in E."""
    _known(targets, _TARGETS, "targets")
    for v, key in (("T", "mean_M_ug"), ("E", "mean_K_N_per_m")):
        if v in half_widths and key not in targets:
            raise PopulationError(f"[{v}] has no nominal; give it, or targets.{key} from which it follows")
        if key in targets and v not in half_widths:
            raise PopulationError(f"targets.{key} is given, but [{v}] leaves no nominal to solve for: remove one")
    for v in half_widths:
        if v not in ("E", "T"):
            raise PopulationError(f"[{v}] has no nominal; only those of E and T can follow from targets")
    if "T" in half_widths:
        known["T"] = _thickness(half_widths["T"], _number(targets, "mean_M_ug"))
    if "E" in half_widths:
        half, target = half_widths["E"], _number(targets, "mean_K_N_per_m")
        known["E"] = _around(portable(target / known["T"].expect(lambda t: stiffness(1.0, t))), half)


@functools.cache
def _thickness(half: float, mean_mass_ug: float) -> Bounded:
    """Uniform T with E[M] as given. Bisection: M grows with T, and scipy.optimize would cost 0.2 s to import."""
    lo, hi = A1 / (1.0 - half), 100.0
    lightest, heaviest = _around(lo, half).expect(mass), _around(hi, half).expect(mass)
    if not lightest < mean_mass_ug < heaviest:
        raise PopulationError(
            f"targets.mean_M_ug is {mean_mass_ug:g}; with this half_width Eq. 6 gives {lightest:.3g} to "
            f"{heaviest:.3g} µg"
        )
    while hi - lo > 1e-14 * hi:
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if _around(mid, half).expect(mass) < mean_mass_ug else (lo, mid)
    return _around(portable(hi), half)


def _around(nominal: float, half: float) -> Bounded:
    return Bounded(lower=nominal * (1.0 - half), upper=nominal * (1.0 + half))


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


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data[key]
    if not isinstance(value, Mapping):
        raise PopulationError(f"{key} is {value!r}; it must be a table, [{key}]")
    return value


def _number(table: Mapping[str, Any], key: str, default: float | None = None) -> float:
    value = table.get(key, default)
    if value is None:
        raise PopulationError(f"{key} is missing")
    return finite_number(key, value, PopulationError)


def _known(table: Mapping[str, Any], allowed: Iterable[str], where: str) -> None:
    check_keys(table, allowed, f"[{where}] " if where else "", PopulationError)
