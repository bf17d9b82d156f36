"""Claims about formulas: what is arithmetic is computed as Python computes it, and nothing else ever runs."""

from __future__ import annotations

import math
import re
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from examples import examples
from softclose.population import PopulationError
from softclose.population.expression import (
    DEEPEST,
    FUNCTIONS,
    MOST_CHARACTERS,
    MOST_NODES,
    ExpressionError,
    parsed,
)
from softclose.population.formula import Formula

VALUES = {"G": 3.7, "E": 78.0, "T": 1.9, "pi": math.pi}
FINITE = st.floats(0.01, 100.0).map(lambda x: repr(round(x, 4)))
ONE = ("sqrt", "exp", "log", "log10", "sin", "cos", "tan", "arcsin", "sinh", "tanh", "arctan", "abs", "log1p", "floor")
TWO = ("minimum", "maximum", "arctan2", "hypot", "fmod")
SIGNS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal, "!=": np.not_equal}
SUMS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
Pair = tuple[str, float]


def _power(x: float, n: int) -> float:
    product = np.prod(np.full(abs(n), x))
    return 1.0 / product if n < 0 else product


def _grown(inner: st.SearchStrategy[Pair]) -> st.SearchStrategy[Pair]:
    """Texts, each beside its value, which numpy computes as the text is put together."""
    return st.one_of(
        st.tuples(inner, st.sampled_from(sorted(SUMS)), inner).map(
            lambda p: (f"({p[0][0]} {p[1]} {p[2][0]})", SUMS[p[1]](p[0][1], p[2][1]))
        ),
        st.tuples(inner, st.integers(-3, 3)).map(lambda p: (f"({p[0][0]})**{p[1]}", _power(p[0][1], p[1]))),
        inner.map(lambda x: (f"-({x[0]})", -x[1])),
        st.tuples(st.sampled_from(ONE), inner).map(lambda p: (f"{p[0]}({p[1][0]})", getattr(np, p[0])(p[1][1]))),
        st.tuples(st.sampled_from(TWO), inner, inner).map(
            lambda p: (f"{p[0]}({p[1][0]}, {p[2][0]})", getattr(np, p[0])(p[1][1], p[2][1]))
        ),
        st.tuples(inner, st.sampled_from(sorted(SIGNS)), inner, inner, inner).map(
            lambda p: (
                f"where(({p[0][0]} {p[1]} {p[2][0]}) & ~({p[0][0]} > 50) | (2 < 1), {p[3][0]}, {p[4][0]})",
                p[3][1] if SIGNS[p[1]](p[0][1], p[2][1]) and not p[0][1] > 50 else p[4][1],
            )
        ),
    )


LEAVES = st.sampled_from([(name, np.float64(x)) for name, x in VALUES.items()]) | FINITE.map(
    lambda text: (text, np.float64(text))
)
FORMULAS = st.recursive(LEAVES, lambda inner: _grown(inner), max_leaves=12)


@settings(max_examples=examples(300))
@given(data=st.data())
def test_a_formula_is_computed_as_numpy_computes_it_step_by_step(data: st.DataObject) -> None:
    with np.errstate(all="ignore"):
        text, expected = data.draw(FORMULAS)
    try:
        found = parsed(text)(VALUES)
    except ExpressionError as e:
        assert re.search(r"has more than|characters|levels deep", str(e))  # noqa: PT017
        return
    np.testing.assert_array_equal(found, expected)


@given(data=st.data(), n=st.integers(1, 70), i=st.integers(0, 69))
def test_each_switch_is_computed_alone(data: st.DataObject, n: int, i: int) -> None:
    """The same bits in a lot of any size, of strided columns or not: blocks cut a lot anywhere."""
    with np.errstate(all="ignore"):
        text, _ = data.draw(FORMULAS)
    many = np.random.default_rng(1).uniform(0.5, 9.0, (70, 3))
    try:
        formula = parsed(text)
    except ExpressionError:
        return
    columns = {"G": many[:, 0], "E": many[:, 1], "T": many[:, 2], "pi": math.pi}
    start = min(i, 70 - n)
    whole = np.broadcast_to(formula(columns), 70)[start : start + n]
    part = formula({k: v if k == "pi" else v[start : start + n] for k, v in columns.items()})
    np.testing.assert_array_equal(np.broadcast_to(part, n), whole)


@settings(max_examples=examples(500))
@given(
    st.one_of(
        st.text(max_size=60),
        st.text("GETpi0123456789.e+-*/()<>=!&|~, ", max_size=200),
        st.lists(
            st.sampled_from(
                [*FUNCTIONS, *"GET", "(", ")", ",", "**", "-", "1e9", "9", "j", "if", "or", "lambda", "=="]
            ),
            max_size=60,
        ).map(" ".join),
    )
)
@example("1" * 999)
@example("9**9**9**9")
@example("2**2**2**2**2**2**2**2")
@example("-" * 999 + "1")
@example("(" * 999)
@example("(" * 499 + "1" + ")" * 499)
@example("1+" * 499 + "1")
@example("~" * 500 + "1")
@example("G" + "<G" * 400)
@example("G\0")
@example("\ud800")
@example("0in G")
@example("1_000.0e-3_0")
def test_any_text_is_computed_or_refused(text: str) -> None:
    """No text ends in another exception, in time or in memory, whatever it is."""
    tracemalloc.start()
    try:
        found = parsed(text)({"G": np.ones(1000), "E": 2.0, "T": 3.0, **dict.fromkeys(_names(text), 1.0)})
        assert found.dtype == np.float64
    except ExpressionError as e:
        assert str(e)  # noqa: PT017
    finally:
        assert tracemalloc.get_traced_memory()[1] < 20e6
        tracemalloc.stop()


def _names(text: str) -> frozenset[str]:
    return parsed(text).names


@pytest.mark.parametrize("n", [3_000, 100_000])
@pytest.mark.parametrize("part", ["[", "(", "-", "~", "not ", "9", "G+", "{", "f'", "lambda:", "sqrt("])
def test_long_nesting_is_refused_before_it_is_parsed(part: str, n: int) -> None:
    with pytest.raises(ExpressionError, match="characters; at most 1000"):
        parsed(part * n)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("where(f'{print(1)}' == '0', 1, 1)", '"\'" is not allowed'),
        ('"a"', "is not allowed"),
        ("G.real", "a dot after a name"),
        ("(1).__class__", "a dot after a name"),
        ("G[0]", r"'\[' is not allowed"),
        ("{G}", "'{' is not allowed"),
        ("lambda: 1", "':' is not allowed"),
        ("lambda x, y", "invalid syntax"),
        ("__import__(os)", "calls __import__; the functions are sqrt"),
        ("eval(G)", "calls eval"),
        ("sum(G)", "calls sum"),
        ("sqrt(G)(E)", "no plain name"),
        ("sqrt(x=G)", "named values"),
        ("sqrt(*G)", "a star"),
        ("sqrt", r"sqrt is a function; write sqrt\("),
        ("sqrt(G, E)", "sqrt takes 1 value; it is given 2"),
        ("where(G, 1, 2)", "takes a condition"),
        ("G > 3", "is a condition, not a number"),
        ("(G > 3) * 2", r"^\* takes numbers, not a condition"),
        ("where(1 < G < 3, 1, 2)", "chain of comparisons"),
        ("where(G > 1 and G < 3, 1, 2)", "`and` or `or`"),
        ("where(not G, 1, 2)", "`not`"),
        ("1 if G else 2", "`if`"),
        ("G in E", "`in` or `is`"),
        ("G // 2", "//"),
        ("G, E", "list of values"),
        ("(G := 2)", "':' is not allowed"),
        ("G = 2", "invalid syntax"),
        ("2j", "2j is not a number"),
        ("True", "True is not a number"),
        ("None", "None is not a number"),
        ("...", "Ellipsis is not a number"),
        ("1e400", "too large for 64 bits"),
        ("9" * 400, "too large for 64 bits"),
        ("G**101", "101 is too large an exponent"),
        ("G**-1e9", "-1e.09 is too large an exponent"),
        ("", "invalid syntax"),
        ("+".join("G" * 200), "more than 300|levels deep"),
        ("µ + 1", "'µ' is not allowed"),
        ("@G", "'@' is not allowed"),
        ("G; E", "';' is not allowed"),
        ("G # E", "'#' is not allowed"),
    ],
)
def test_what_is_not_arithmetic_is_refused_by_name(text: str, said: str) -> None:
    with pytest.raises(ExpressionError, match=said):
        parsed(text)


def _sum_of(n: int) -> str:
    """A formula of n names, nested as little as can be."""
    return "G" if n == 1 else f"({_sum_of(n // 2)}+{_sum_of(n - n // 2)})"


@pytest.mark.parametrize(
    ("largest", "larger", "said"),
    [
        ("G".ljust(MOST_CHARACTERS), "G".ljust(MOST_CHARACTERS + 1), "1001 characters; at most 1000 are read"),
        ("-" + _sum_of(MOST_NODES // 2), "--" + _sum_of(MOST_NODES // 2), "more than 300 numbers, names and operators"),
        ("-" * (DEEPEST - 1) + "G", "-" * DEEPEST + "G", "nested more than 60 levels deep"),
        ("G**100", "G**100.5", "100.5 is too large an exponent; at most 100"),
    ],
)
def test_a_formula_is_read_up_to_a_limit_that_is_said(largest: str, larger: str, said: str) -> None:
    assert parsed(largest).names == {"G"}
    with pytest.raises(ExpressionError, match=said):
        parsed(larger)


def test_a_value_is_a_float_also_where_a_formula_has_whole_numbers_only() -> None:
    assert parsed("2")({}).dtype == np.float64
    assert parsed("where(1 < 2, 3, 4)")({}).dtype == np.float64


def test_no_text_of_a_file_runs_code(tmp_path: Path) -> None:
    """numexpr ran what an f-string held; the file that each of these would write is not there."""
    mark = tmp_path / "ran"
    code = f"open({str(mark)!r}, 'w')"
    for text in (
        f"where(f'{{{code}}}' == '0', 1, 1)",
        f"where(f\"{{{code}}}\" == '0', 1, 1)",
        code,
        f"[{code} for x in (1,)]",
        f"(lambda: {code})()",
        f"where(1 > 0, {code}, 1)",
        "__import__('os').system('touch ran')",
    ):
        with pytest.raises(PopulationError, match="is no formula"):
            Formula(K=text, M="T")
    assert not mark.exists()


@pytest.mark.parametrize("text", ["9**9**9", "2**2**2**2**2**2", "exp(exp(exp(9)))", "-1 + 0*G", "sqrt(-G)", "G - G"])
def test_a_law_without_a_positive_finite_value_is_refused(text: str) -> None:
    law = Formula(K=text, M="T").law
    with pytest.raises(PopulationError, match="must be above 0"):
        law.switch(np.array([3.7]), np.array([78.0]), np.array([1.9]), 1.0)


@pytest.mark.parametrize("exponent", [0, 1, 2, 3, 7, 50, -1, -3, 0.5, 1.5, -2.5, 51, 0.3, -60])
def test_powers_are_powers(exponent: float) -> None:
    x = np.linspace(0.2, 3.0, 101)
    np.testing.assert_allclose(parsed(f"G**{exponent}")({"G": x}), x**exponent, rtol=1e-13)


def test_a_whole_division_is_a_division() -> None:
    """numexpr computed 1/2 as 0."""
    assert float(parsed("33 / 140 * G")({"G": 1.0})) == 33 / 140


@pytest.mark.parametrize("name", ["sqrt", "where", "lambda", "in", "Lµ", "a b", "1a", "_", "", "__import__"])
def test_a_constant_has_a_name_of_its_own(name: str) -> None:
    with pytest.raises(PopulationError, match="cannot have a constant called"):
        Formula(K="E", M="T", constants=((name, 1.0),))


def test_python_s_own_limits_are_untouched() -> None:
    limit = sys.getrecursionlimit()
    with pytest.raises(ExpressionError):
        parsed("(" * 900)
    assert sys.getrecursionlimit() == limit
