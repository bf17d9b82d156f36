"""Owns series.py and its companions (`*_series.py`): the power series of the fast kernel as straight-line code.

Loops over short arrays cost 450 ns for one step of order 14; the same sums written out keep every coefficient in a
register and cost 42 ns (docs/adr/010). Usage: `python -m softclose.kernel.generate_series` rewrites them.
"""

from __future__ import annotations

import math
from pathlib import Path

from softclose.switch.losses import SLIP_EXPONENT

TARGET = Path(__file__).with_name("series.py")
LOSSY = Path(__file__).with_name("lossy_series.py")
DRIVE = Path(__file__).with_name("drive_series.py")
MODES = Path(__file__).with_name("modes_series.py")
SHAPED = Path(__file__).with_name("shaped_series.py")
TABLE = Path(__file__).with_name("table_series.py")
ORDER = 16
"""Degree of the Taylor polynomial of x."""
TERMS = 12
"""Terms of the flight-time series."""
SHORT = 8
"""Degree of the polynomial of a short bounce."""
DEGREE = 7
"""Degree of the polynomials of a sampled drive."""


HEADER = '''"""Owns the fast kernel's power series as straight-line code. Written by generate_series.py.

`flight_constant`, `flight_driven`: Taylor coefficients of x(t) under Eq. 1. With s = u/(G - x), so s (G - x) = u, and
x'' = c s² - k x, every coefficient follows from the ones before with one division. `constant` and `drive`: those of
u(t). `evaluate`, `descent`, `bend`, `sample` read the polynomial. `flight_time`, `bounce_duration`: after a rebound at
speed w under constant u, energy conservation gives the depth y as a series in the energy w²/2 (dy/dE = 1/force(y)),
and Abel's integral turns its coefficients e_m into those of the time, m B(m, 1/2) 2^(1-m) e_m.

Tuples, not arrays: an array that is passed on costs two atomic operations on its reference count.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ORDER = {order}
TERMS = {terms}
LANES = 16
"""Samples that are computed together in single precision."""
# Sums may be reordered by the compiler, once for all: each switch runs this same scalar code wherever it stands.
# Reordered sums need one copy of the code: everything is inlined into the entry point (`forceinline`). Where a function
# was compiled by itself too, the process that compiled ran another copy than those that loaded the cache: other bits.
_FAST = {{"contract", "reassoc", "nsz"}}
'''


DRIVE_HEADER = '''\
"""Owns the power series of drives that are no cosines, as straight-line code. Written by generate_series.py.

`fading` and `decaying` add exponentials with real and with complex rates; `shifted` is a polynomial about another
point. Under such drives bounces are not told by those before them: `short_...` and `short_return` take one that is
short, and so needs few powers, in one low polynomial.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST

DEGREE = {degree}
SHORT = {short}
'''
MODES_HEADER = '''\
"""Owns the power series of a switch of two modes as straight-line code. Written by generate_series.py.

a'' = p F - ka a - da a' and b'' = q F - kb b - db b', F = h (u / (G - e))² - f e' / (G - e)³, e = ea a + eb b: what
the modes share is the electrode. `blend` is another point that moves with both, `press` and
`press_under` are the force on a held contact.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST
'''
SHAPED_HEADER = '''\
"""Owns the power series of a switch whose forces are shaped otherwise. Written by generate_series.py.

x'' = c s² - k x - cubic x³ - d x' - f w with s = u / (G + coat - x): a beam that stretches, over a dielectric. Behind a
film whose gas slips w g(h) = x' with g = h³ + slip h^(3 - a), h = G - x the film's thickness and a = {exponent}: powers
of a series, and a quotient, have recurrences as products do. slip: `softclose.switch.losses.SLIP` times the mean free
path to the power a; 0: g = h³.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST
'''
TABLE_HEADER = '''\
"""Owns the power series of a switch whose capacitance is a table. Written by generate_series.py.

x'' = p u² - k x - cubic x³ - d x' - f w, where p is a parabola within a cell of the table, g0 + g1 z + g2 z² with
z = x - origin, and w the film's of `shaped_series`.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST
'''
LOSSY_HEADER = '''\
"""Owns the power series of a switch that loses energy as straight-line code. Written by generate_series.py.

x'' = c s² - k x - d x' - f x' / (G - x)³ with s = u / (G - x): to Eq. 1, damping adds a term to every recurrence. The
film's force is a derivative, that of f r² / 2 with r = 1 / (G - x): its coefficients are those of r², which at constant
voltage are those of s² but for a factor. So the film costs a switch under constant voltage nothing.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST
'''


def statement(target: str, terms: list[str], head: str = "") -> str:
    """`target = head(term + term ...)`, wrapped at 120 columns within the parentheses."""
    total = " + ".join(terms)
    one = f"    {target} = {head}({total})" if head and len(terms) > 1 else f"    {target} = {head}{total}"
    if len(one) <= 120:
        return one
    body = "\n        + ".join(terms) if len(total) > 112 else total
    return f"    {target} = {head}(\n        {body}\n    )"


def function(name: str, arguments: str, doc: str, lines: list[str]) -> str:
    head = '@njit(error_model="numpy", fastmath=_FAST, forceinline=True)\n'
    head += f"def {name}({arguments}):  # type: ignore[no-untyped-def]\n"
    return "\n\n" + head + f'    """{doc}"""\n' + "\n".join(lines) + "\n"


def square(name: str, n: int) -> list[str]:
    """Terms of half the n-th coefficient of name²."""
    terms = [f"{name}{j} * {name}{n - j}" for j in range((n + 1) // 2)]
    return terms + ([f"0.5 * {name}{n // 2} * {name}{n // 2}"] if n % 2 == 0 else [])


def listing(head: str, names: list[str], tail: str = "") -> str:
    one = f"    {head}{', '.join(names)}{tail}"
    if len(one) <= 120:
        return one
    body = "".join(f"        {name},\n" for name in names)
    return f"    {head}(\n{body}    ){tail}"


def unpack(names: list[str], source: str) -> str:
    return listing("", names, f" = {source}")


def pack(names: list[str]) -> str:
    return listing("return ", names)


def xs(order: int) -> list[str]:
    """Coefficients of x."""
    return [f"x{n}" for n in range(order + 1)]


def us(order: int) -> list[str]:
    """Coefficients of the voltage that those of x take."""
    return [f"u{n}" for n in range(order - 1)]


def ds(order: int) -> list[str]:
    """Coefficients of v."""
    return ["x1", *(f"{float(n)} * x{n}" for n in range(2, order + 1))]


def unpack_drive(order: int, given: int) -> str:
    """Of the coefficients that a polynomial of degree `given` takes those that one of degree `order` does."""
    return unpack([f"{'' if n < order - 1 else '_'}u{n}" for n in range(given - 1)], "u")


def flight(driven: bool, order: int, prefix: str = "", given: int | None = None) -> str:
    last = order - 1
    lines = [unpack_drive(order, given or order)] if driven else []
    lines += ["    r = 1.0 / (gap - x0)", f"    s0 = {'u0' if driven else 'u'} * r", "    z1 = x1 * r"]
    lines += ["    x2 = 0.5 * (c * (s0 * s0) - k * x0)", "    z2 = x2 * r"]
    for n in range(1, last):
        terms = [f"r * u{n}"] if driven else []
        lines.append(statement(f"s{n}", terms + [f"z{j} * s{n - j}" for j in range(1, n + 1)]))
        scale = 1.0 / ((n + 1) * (n + 2))
        lines.append(statement("q", square("s", n)))
        lines.append(f"    x{n + 2} = c * q * {2.0 * scale!r} - k * x{n} * {scale!r}")
        if n + 2 < last:
            lines.append(f"    z{n + 2} = x{n + 2} * r")
    lines.append(pack(xs(order)))
    if driven:
        top = "SHORT" if prefix else "ORDER"
        doc = f"Coefficients 0..{top} of x where u has the coefficients u[0..{top}-2]."
        return function(prefix + "flight_driven", "x0, x1, u, gap, c, k", doc, lines)
    return function("flight_constant", "x0, x1, u, gap, c, k", "Coefficients 0..ORDER of x at constant u.", lines)


def lossy_flight(driven: bool, film: bool, order: int, prefix: str = "", given: int | None = None) -> str:
    """With `film`, q and s are those of r = 1 / (G - x); at constant voltage s² is u² r²."""
    last = order - 1
    own = driven or not film
    lines = [unpack_drive(order, given or order)] if driven else []
    lines += ["    r0 = 1.0 / (gap - x0)", "    z1 = x1 * r0"]
    if film:
        lines += ["    r1 = z1 * r0", "    p1 = r0 * r1"]
    if film and not driven:
        lines += ["    p0 = 0.5 * r0 * r0", "    pull = 2.0 * c * u * u"]
    if own:
        lines.append(f"    s0 = {'u0' if driven else 'u'} * r0")
    for n in range(last):
        if n and own:
            terms = [f"r0 * u{n}"] if driven else []
            lines.append(statement(f"s{n}", terms + [f"z{j} * s{n - j}" for j in range(1, n + 1)]))
        if n and film:
            lines.append(statement(f"r{n + 1}", [f"z{j} * r{n + 1 - j}" for j in range(1, n + 2)]))
            lines.append(statement(f"p{n + 1}", square("r", n + 1)))
        scale = 1.0 / ((n + 1) * (n + 2))
        if own:
            lines.append(statement("q", square("s", n)))
        force = f"c * q * {2.0 * scale!r}" if own else f"pull * p{n} * {scale!r}"
        loss = f"d * x{n + 1}" + (f" + f * p{n + 1}" if film else "")
        lines.append(f"    x{n + 2} = {force} - k * x{n} * {scale!r} - ({loss}) * {1.0 / (n + 2)!r}")
        if n + 2 < (order if film else last):
            lines.append(f"    z{n + 2} = x{n + 2} * r0")
    lines.append(pack(xs(order)))
    name = prefix + ("film" if film else "damped") + ("_driven" if driven else "_constant")
    at = "where u has the coefficients u[0..]" if driven else "at constant u"
    last_power = "SHORT" if prefix else "ORDER"
    film_doc = ", behind a film" if film else ""
    return function(
        name,
        "x0, x1, u, gap, c, k, d" + (", f" if film else ""),
        f"Coefficients 0..{last_power} of x with damping{film_doc}, {at}.",
        lines,
    )


_POWER = 3.0 - SLIP_EXPONENT


def slipping_begins() -> list[str]:
    """Of a film that slips the series at 0: h, its square a, slip h^power e and what divides x', w = x' / g."""
    lines = ["    h0 = gap - x0", "    i0 = 1.0 / h0", "    a0 = h0 * h0"]
    return [*lines, f"    e0 = slip * h0**{_POWER!r}", "    j0 = 1.0 / (h0 * a0 + e0)", "    w0 = x1 * j0"]


def slipping(n: int) -> list[str]:
    """Its n-th coefficients. Sums run over x_j, whose sign is h's turned: h = h0 - x1 t - x2 t² - ..."""
    inner = [f"x{j} * x{n - j}" for j in range(1, n)]
    lines = [statement(f"a{n}", [f"-2.0 * h0 * x{n}", *inner])]
    lines.append(statement("b", [f"h0 * a{n}", *(f"-x{j} * a{n - j}" for j in range(1, n + 1))]))
    each = [f"{((_POWER + 1.0) * j - n) / n!r} * x{j} * e{n - j}" for j in range(1, n + 1)]
    lines.append(statement(f"e{n}", each, head="-i0 * "))
    lines.append(f"    g{n} = b + e{n}")
    each = [f"{float(n + 1)} * x{n + 1}", *(f"-g{j} * w{n - j}" for j in range(1, n + 1))]
    return [*lines, statement(f"w{n}", each, head="j0 * ")]


def shaped_flight(driven: bool, film: bool, order: int, prefix: str = "", given: int | None = None) -> str:
    """Cubic stiffness and a dielectric always; with `film` one that may slip."""
    lines = [unpack_drive(order, given or order)] if driven else []
    lines += ["    r0 = 1.0 / (gap + coat - x0)", "    z1 = x1 * r0", f"    s0 = {'u0' if driven else 'u'} * r0"]
    if film:
        lines += slipping_begins()
    for n in range(order - 1):
        scale = 1.0 / ((n + 1) * (n + 2))
        if n:
            terms = [f"r0 * u{n}"] if driven else []
            lines.append(statement(f"s{n}", terms + [f"z{j} * s{n - j}" for j in range(1, n + 1)]))
        lines.append(statement("q", square("s", n)))
        lines.append(statement(f"y{n}", square("x", n)))
        lines.append(statement("m", [f"y{j} * x{n - j}" for j in range(n + 1)]))
        if n and film:
            lines += slipping(n)
        lines.append(f"    force = 2.0 * c * q - k * x{n} - 2.0 * cubic * m" + (f" - f * w{n}" if film else ""))
        lines.append(f"    x{n + 2} = force * {scale!r} - d * x{n + 1} * {1.0 / (n + 2)!r}")
        if n + 2 < order - 1:
            lines.append(f"    z{n + 2} = x{n + 2} * r0")
    lines.append(pack(xs(order)))
    name = prefix + ("shaped_film" if film else "shaped") + ("_driven" if driven else "_constant")
    at = "where u has the coefficients u[0..]" if driven else "at constant u"
    doc = f"Coefficients 0..{'SHORT' if prefix else 'ORDER'} of x{', behind a film' if film else ''}, {at}."
    return function(name, "x0, x1, u, gap, c, k, d, cubic, coat" + (", f, slip" if film else ""), doc, lines)


def table_flight(driven: bool, film: bool, order: int, prefix: str = "", given: int | None = None) -> str:
    """The film's g_n are called as in `slipping`; the parabola's coefficients q0, q1, q2."""
    lines = [unpack_drive(order, given or order)] if driven else []
    lines += ["    z0 = x0 - origin", "    p0 = q0 + z0 * (q1 + q2 * z0)", "    q2 += q2"]
    lines += slipping_begins() if film else []
    if not driven:
        lines.append("    v0 = u * u")
    for n in range(order - 1):
        if driven:
            lines.append(statement("v", square("u", n)))
            lines.append(f"    v{n} = v + v")
        if n:
            terms = [term.replace("x0", "z0") for term in square("x", n)]
            lines.append(statement("m", terms))
            lines.append(f"    p{n} = q1 * x{n} + q2 * m")
        pull = [f"p{j} * v{n - j}" for j in range(n + 1)] if driven else [f"p{n} * v0"]
        lines.append(statement("pull", pull))
        lines.append(statement(f"y{n}", square("x", n)))
        lines.append(statement("m", [f"y{j} * x{n - j}" for j in range(n + 1)]))
        lines += slipping(n) if n and film else []
        scale = 1.0 / ((n + 1) * (n + 2))
        lines.append(f"    force = pull - k * x{n} - 2.0 * cubic * m" + (f" - f * w{n}" if film else ""))
        lines.append(f"    x{n + 2} = force * {scale!r} - d * x{n + 1} * {1.0 / (n + 2)!r}")
    lines.append(pack(xs(order)))
    name = prefix + ("table_film" if film else "table") + ("_driven" if driven else "_constant")
    at = "where u has the coefficients u[0..]" if driven else "at constant u"
    doc = f"Coefficients 0..{'SHORT' if prefix else 'ORDER'} of x{', behind a film' if film else ''}, {at}."
    return function(name, "x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2" + (", f, slip" if film else ""), doc, lines)


def two(film: bool, order: int) -> str:
    """Damping is always there. ha, hb: h p and h q of the header; fa, fb: f p and f q."""
    lines = [unpack(us(order), "u"), "    e0 = ea * a0 + eb * b0", "    e1 = ea * a1 + eb * b1"]
    lines += ["    r0 = 1.0 / (gap - e0)", "    z1 = e1 * r0", "    s0 = u0 * r0"]
    if film:
        lines += ["    r1 = z1 * r0", "    p1 = r0 * r1"]
    for n in range(order - 1):
        if n:
            lines.append(statement(f"s{n}", [f"r0 * u{n}", *(f"z{j} * s{n - j}" for j in range(1, n + 1))]))
        if n and film:
            lines.append(statement(f"r{n + 1}", [f"z{j} * r{n + 1 - j}" for j in range(1, n + 2)]))
            lines.append(statement(f"p{n + 1}", square("r", n + 1)))
        scale = 1.0 / ((n + 1) * (n + 2))
        lines.append(statement("q", square("s", n)))
        lines.append(f"    q *= {2.0 * scale!r}")
        for m in "ab":
            loss = f"d{m} * {m}{n + 1}" + (f" + f{m} * p{n + 1}" if film else "")
            lines.append(f"    {m}{n + 2} = h{m} * q - k{m} * {m}{n} * {scale!r} - ({loss}) * {1.0 / (n + 2)!r}")
        if n + 2 < (order if film else order - 1):
            lines.append(f"    z{n + 2} = (ea * a{n + 2} + eb * b{n + 2}) * r0")
    for m in "ab":
        lines.append(listing(f"found_{m} = (", [f"{m}{n}" for n in range(order + 1)], ")"))
    lines.append("    return found_a, found_b")
    doc = (
        "Coefficients 0..ORDER of a and b"
        + (" behind a film" if film else "")
        + ", where u has the coefficients u[0..ORDER-2]."
    )
    arguments = "a0, a1, b0, b1, u, gap, ea, eb, ha, hb, ka, kb, da, db" + (", fa, fb" if film else "")
    return function("two_film" if film else "two", arguments, doc, lines)


def blend(order: int) -> str:
    lines = [unpack([f"{m}{n}" for n in range(order + 1)], source) for m, source in (("a", "a"), ("b", "b"))]
    lines.append(pack([f"p * a{n} + q * b{n}" for n in range(order + 1)]))
    return function("blend", "a, b, p, q", "Coefficients of p a + q b.", lines)


def at_rest(order: int) -> str:
    lines = [unpack(["x0", "_x1", *xs(order)[2:]], "x"), pack(["x0", "0.0", *xs(order)[2:]])]
    return function("at_rest", "x", "The same motion from rest: without the rounding of its speed.", lines)


def press(order: int) -> str:
    lines = [unpack(xs(order), "x")]
    terms = []
    for n in range(order - 1):
        parts = f"p2 * ({float((n + 1) * (n + 2))} * x{n + 2}) + p1 * ({float(n + 1)} * x{n + 1}) + p0 * x{n}"
        terms.append(f"-({parts})" if n else f"-({parts} + pc)")
    lines.append(pack([*terms, "0.0", "0.0"]))
    return function("press", "x, p2, p1, p0, pc", "Coefficients of -(p2 x'' + p1 x' + p0 x + pc).", lines)


def press_under(order: int) -> str:
    lines = [unpack([*xs(order - 1), f"_x{order}"], "x"), unpack(us(order), "u")]
    terms = []
    for n in range(order - 1):
        lines.append(statement(f"q{n}", square("u", n)))
        parts = f"p1 * ({float(n + 1)} * x{n + 1}) + p0 * x{n} + 2.0 * pu * q{n}"
        terms.append(f"-({parts})" if n else f"-({parts} + pc)")
    lines.append(pack([*terms, "0.0", "0.0"]))
    return function("press_under", "x, u, p1, p0, pc, pu", "Coefficients of -(pu u² + p1 x' + p0 x + pc).", lines)


def chain(target: str, coefficients: list[str], variable: str, indent: str = "    ") -> list[str]:
    """Horner's rule, a line per coefficient."""
    lines = [f"{indent}{target} = {coefficients[-1]}"]
    return lines + [f"{indent}{target} = {a} + {variable} * {target}" for a in reversed(coefficients[:-1])]


def evaluate(order: int) -> str:
    # Even and odd powers apart: two short chains of dependent operations instead of a long one.
    lines = [unpack(xs(order), "x"), "    h2 = h * h"]
    for target, series in (("x", xs(order)), ("v", ds(order))):
        lines += chain(f"{target}_even", series[0::2], "h2") + chain(f"{target}_odd", series[1::2], "h2")
    lines.append("    return x_even + h * x_odd, v_even + h * v_odd")
    return function("evaluate", "x, h", "Position and velocity of the polynomial x at h.", lines)


def bend(order: int) -> str:
    bs = [f"{float(n * (n - 1))} * abs(x{n})" for n in range(2, order + 1)]
    lines = [
        unpack(["_x0", "_x1", *xs(order)[2:]], "x"),
        "    h2 = h * h",
        *chain("even", bs[0::2], "h2"),
        *chain("odd", bs[1::2], "h2"),
    ]
    lines.append("    return even + h * odd")
    return function("bend", "x, h", "Bound on |x''| over [0, h].", lines)


def descent(order: int) -> str:
    lines = [unpack(["_x0", *xs(order)[1:]], "x"), "    h2 = h * h"]
    lines += chain("y_even", xs(order)[1::2], "h2") + chain("y_odd", xs(order)[2::2], "h2")
    lines += chain("v_even", ds(order)[0::2], "h2") + chain("v_odd", ds(order)[1::2], "h2")
    lines.append("    return -(y_even + h * y_odd), v_even + h * v_odd")
    doc = "(x(0) - x(h)) / h, free of cancellation however small h is, and the velocity at h."
    return function("descent", "x, h", doc, lines)


def sample(order: int) -> str:
    doc = "x and v of the polynomial that starts at t, at times[first:stop], into row i."
    lines = [unpack(xs(order), "x")]
    lines += [f"    d{n} = {float(n)} * x{n}" for n in range(2, order + 1)]
    lines.append("    for m in range(stop - first):")
    # A signed index could wrap around, and such a loop is not vectorised.
    lines += ["        j = np.uintp(first + m)", "        s = times[j] - t"]
    lines += chain("y", xs(order), "s", " " * 8)
    lines.append("        x_out[i, j] = y")
    lines += chain("y", ["x1", *(f"d{n}" for n in range(2, order + 1))], "s", " " * 8)
    lines.append("        v_out[i, j] = y")
    return function("sample", "x, t, times, first, stop, i, x_out, v_out", doc, lines)


def sample_single(order: int) -> str:
    doc = "`sample` in single precision, in whole blocks of LANES: what is written beyond `stop` is overwritten later."
    lines = [unpack(xs(order), "x")]
    lines += [f"    f{n} = np.float32(x{n})" for n in range(order + 1)]
    lines += [f"    d{n} = np.float32({float(n)} * x{n})" for n in range(2, order + 1)]
    lines += ["    whole = first", "    while whole < stop and whole + LANES <= x_out.shape[1]:"]
    velocities = ["f1", *(f"d{n}" for n in range(2, order + 1))]
    for indent, index in ((12, "whole + m"), (8, "whole")):
        pad = " " * indent
        if indent == 12:
            lines += ["        for m in range(LANES):"]
        else:
            lines += ["        whole += LANES", "    while whole < stop:"]
        lines += [f"{pad}j = np.uintp({index})", f"{pad}s = np.float32(times[j] - t)"]
        lines += [*chain("y", [f"f{n}" for n in range(order + 1)], "s", pad), f"{pad}x_out[i, j] = y"]
        lines += [*chain("y", velocities, "s", pad), f"{pad}v_out[i, j] = y"]
    lines.append("        whole += 1")
    return function("sample_single", "x, t, times, first, stop, i, x_out, v_out", doc, lines)


def constant(order: int) -> str:
    lines = [listing("return ", ["u", *["0.0"] * (order - 2)])]
    return function("constant", "u", "Coefficients of a constant voltage.", lines)


def drive(order: int) -> str:
    doc = "Coefficients u plus those of a ramp a cos(omega t + angle); a cos(angle) = cosine, a sin(angle) = sine."
    lines = [unpack(us(order), "u"), "    u0 += cosine", "    p = omega", "    u1 -= sine * p"]
    for n in range(2, order - 1):
        name = "cosine" if n % 2 == 0 else "sine"
        sign = "-" if n % 4 in (1, 2) else "+"
        lines += ["    p = p * omega", f"    u{n} {sign}= {name} * (p * {1.0 / math.factorial(n)!r})"]
    lines.append(pack(us(order)))
    return function("drive", "u, cosine, sine, omega", doc, lines)


def fading(order: int) -> str:
    doc = "Coefficients u plus those of a exp(-decay t)."
    lines = [unpack(us(order), "u"), "    u0 += a", "    p = a * decay", "    u1 -= p"]
    for n in range(2, order - 1):
        lines += ["    p = p * decay", f"    u{n} {'-' if n % 2 else '+'}= p * {1.0 / math.factorial(n)!r}"]
    lines.append(pack(us(order)))
    return function("fading", "u, a, decay", doc, lines)


def decaying(order: int) -> str:
    doc = "Coefficients u plus those of the real part of (cosine + i sine) exp((i omega - decay) t)."
    lines = [unpack(us(order), "u"), "    u0 += cosine", "    p = cosine", "    q = sine"]
    for n in range(1, order - 1):
        lines += ["    h = omega * p - decay * q", "    p = -decay * p - omega * q", "    q = h"]
        lines.append(f"    u{n} += p * {1.0 / math.factorial(n)!r}")
    lines.append(pack(us(order)))
    return function("decaying", "u, cosine, sine, omega, decay", doc, lines)


def shifted(degree: int, order: int) -> str:
    doc = "Coefficients about s of the polynomial u0 + p[i, 0, 0] s + p[i, 1, 0] s² + ... with DEGREE terms."
    lines = [f"    u{n} = p[i, {n - 1}, 0]" for n in range(1, degree + 1)]
    for j in range(degree):
        lines += [f"    u{k} += s * u{k + 1}" for k in range(degree - 1, j - 1, -1)]
    lines.append(listing("return ", [*(f"u{n}" for n in range(degree + 1)), *["0.0"] * (order - 2 - degree)]))
    return function("shifted", "u0, p, i, s", doc, lines)


def short_return(order: int) -> str:
    doc = (
        "Instant and speed of the return of a short bounce x that starts on the contact; (-1, 0) where it is too long."
    )
    lines = [unpack(["_x0", *xs(order)[1:]], "x"), "    if x2 <= 0.0:", "        return -1.0, 0.0", "    t = -x1 / x2"]
    lines += ["    for _ in range(4):"]
    lines += chain("y", xs(order)[1:], "t", " " * 8)
    lines += chain("d", [f"{float(n)} * x{n + 1}" for n in range(1, order)], "t", " " * 8)
    lines += ["        t -= y / d"]
    lines += chain("y", ds(order), "t")
    lines += ["    t2 = t * t", "    t4 = t2 * t2", f"    rest = max(abs(x{order - 1}), abs(x{order} * t)) * t4 * t2"]
    lines += [
        "    if not (abs(x3) * t < 0.2 * x2 and rest < 10.0 * rtol * y):",
        "        return -1.0, 0.0",
        "    return t, y",
    ]
    return function("short_return", "x, rtol", doc, lines)


def flight_time(terms: int) -> str:
    doc = "Coefficients m = 0.. of w^(2m+1) in the flight time after a rebound at speed w; constant pull = c u² closes."
    lines = ["    p0 = 1.0 / (gap - travel)", "    a0 = pull * (p0 * p0) - k * travel", "    b0 = 1.0 / a0"]
    lines += ["    e1 = b0", "    f0 = 2.0 * e1"]
    for n in range(1, terms):
        lines.append(statement(f"p{n}", [f"e{j} * p{n - j}" for j in range(1, n + 1)], head="-p0 * "))
        lines.append(statement("q", square("p", n)))
        lines.append(f"    a{n} = 2.0 * pull * q + k * e{n}")
        lines.append(statement(f"b{n}", [f"a{j} * b{n - j}" for j in range(1, n + 1)], head="-b0 * "))
        m = n + 1
        lines.append(f"    e{m} = b{n} * {1.0 / m!r}")
        factor = m * math.gamma(m) * math.sqrt(math.pi) / math.gamma(m + 0.5) * 2.0 ** (1 - m)
        lines.append(f"    f{n} = {factor!r} * e{m}")
    lines.append(pack([f"f{n}" for n in range(terms)]))
    return function("flight_time", "travel, gap, pull, k", doc, lines)


def bounce_duration(terms: int) -> str:
    fs = [f"f{n}" for n in range(terms)]
    lines = [unpack(fs, "f"), "    w2 = w * w", "    w4 = w2 * w2"]
    lines += [*chain("even", fs[0::2], "w4"), *chain("odd", fs[1::2], "w4"), "    return w * (even + w2 * odd)"]
    return function("bounce_duration", "f, w", "Flight time [µs] after a rebound at speed w.", lines)


def render(order: int = ORDER, terms: int = TERMS) -> str:
    """The whole module for a polynomial of degree `order` (6 or more) and `terms` terms of a bounce (3 or more)."""
    motion = [flight(False, order), flight(True, order), constant(order), drive(order)]
    reading = [evaluate(order), bend(order), descent(order), sample(order), sample_single(order)]
    return "".join(
        [HEADER.format(order=order, terms=terms), *motion, *reading, flight_time(terms), bounce_duration(terms)]
    )


def render_lossy(order: int = ORDER) -> str:
    """The module of the lossy flights for a polynomial of degree `order` (6 or more)."""
    return LOSSY_HEADER + "".join(
        lossy_flight(driven, film, order) for film in (False, True) for driven in (False, True)
    )


def render_drive(order: int = ORDER, degree: int = DEGREE, short: int = SHORT) -> str:
    """The module of drives that are no cosines, and of short bounces under any drive that changes."""
    flights = [flight(True, short, "short_", order)]
    flights += [lossy_flight(True, film, short, "short_", order) for film in (False, True)]
    parts = [fading(order), decaying(order), shifted(degree, order), *flights, short_return(short)]
    return DRIVE_HEADER.format(degree=degree, short=short) + "".join(parts)


def render_modes(order: int = ORDER) -> str:
    """The module of two modes."""
    motion = [two(False, order), two(True, order), blend(order), at_rest(order)]
    return MODES_HEADER + "".join([*motion, press(order), press_under(order)])


def render_shaped(order: int = ORDER, short: int = SHORT) -> str:
    """The module of stretching, a dielectric and films that slip, short bounces too."""
    both = (False, True)
    flights = [shaped_flight(driven, film, order) for film in both for driven in both]
    flights += [shaped_flight(True, film, short, "short_", order) for film in both]
    return SHAPED_HEADER.format(exponent=SLIP_EXPONENT) + "".join(flights)


def render_table(order: int = ORDER, short: int = SHORT) -> str:
    """The module of tables of capacitance, short bounces too."""
    both = (False, True)
    flights = [table_flight(driven, film, order) for film in both for driven in both]
    flights += [table_flight(True, film, short, "short_", order) for film in both]
    return TABLE_HEADER + "".join(flights)


if __name__ == "__main__":
    TARGET.write_text(render(), encoding="utf-8")
    LOSSY.write_text(render_lossy(), encoding="utf-8")
    DRIVE.write_text(render_drive(), encoding="utf-8")
    MODES.write_text(render_modes(), encoding="utf-8")
    SHAPED.write_text(render_shaped(), encoding="utf-8")
    TABLE.write_text(render_table(), encoding="utf-8")
