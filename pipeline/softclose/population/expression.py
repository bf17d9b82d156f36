"""Owns what a formula in a file may be: arithmetic over numbers, read by Python's own parser and walked over numpy.

A stranger's file brings the text, so the walk knows what is allowed and refuses the rest by name: nothing is compiled,
imported, looked up or called but the functions of `FUNCTIONS`. Everything is float64: no integer grows without bound.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from softclose.arrays import FloatArray

MOST_CHARACTERS = 1000
MOST_NODES = 300
"""Numbers, names, operators and calls of one formula."""
DEEPEST = 60
"""How far formulas may be nested: Python's parser and the walk are recursive."""
LARGEST_EXPONENT = 100.0
"""Of an exponent that is a number."""

FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    **{
        name: (getattr(np, name), 1)
        for name in (
            *("sqrt", "exp", "expm1", "log", "log1p", "log2", "log10", "abs", "sign", "floor", "ceil", "trunc"),
            *("sin", "cos", "tan", "arcsin", "arccos", "arctan"),
            *("sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh"),
        )
    },
    **{name: (getattr(np, name), 2) for name in ("arctan2", "hypot", "minimum", "maximum", "fmod", "copysign")},
    "where": (np.where, 3),
}
"""Name -> numpy's function and the number of its arguments; the first one of `where` is a condition."""

_ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[..., Any]]] = {
    ast.Add: ("+", np.add),
    ast.Sub: ("-", np.subtract),
    ast.Mult: ("*", np.multiply),
    ast.Div: ("/", np.divide),
    ast.Pow: ("**", np.power),
}
_COMPARISONS: dict[type[ast.cmpop], Callable[..., Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}
_BOTH: dict[type[ast.operator], Callable[..., Any]] = {ast.BitAnd: np.logical_and, ast.BitOr: np.logical_or}

_FORBIDDEN = re.compile(r"[^A-Za-z0-9_ \t\n+\-*/().,<>=!&|~]")
_CALLED = {
    ast.Attribute: "a dot after a name",
    ast.Tuple: "a list of values",
    ast.BoolOp: "`and` or `or` (write & or | between conditions in brackets)",
    ast.IfExp: "`if` (write where(condition, a, b))",
    ast.NamedExpr: "an assignment",
    ast.Starred: "a star before a value",
    ast.Lambda: "`lambda`",
}


class ExpressionError(ValueError):
    """A text that is no formula; the message says what in it is not allowed."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A formula whose every part has been found to be allowed."""

    text: str
    names: frozenset[str]
    """The names that have to be given a value."""
    tree: ast.expr

    def __call__(self, values: Mapping[str, float | FloatArray]) -> FloatArray:
        """Its value, float64, in the shape of the values of its names (broadcast); inf and nan as IEEE has them."""
        # Contiguous arrays: numpy takes other loops over strided ones, whose last bits differ for exp, log and sin.
        given = {n: np.ascontiguousarray(values[n], dtype=np.float64).reshape(np.shape(values[n])) for n in self.names}
        with np.errstate(all="ignore"):
            return np.asarray(_value(self.tree, given), dtype=np.float64)


@lru_cache(maxsize=256)
def parsed(text: str) -> Expression:
    """Read a formula. Raises ExpressionError."""
    if len(text) > MOST_CHARACTERS:
        raise ExpressionError(f"it has {len(text)} characters; at most {MOST_CHARACTERS} are read")
    odd = _FORBIDDEN.search(text)
    if odd:
        raise ExpressionError(f"{odd.group()!r} is not allowed in a formula")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what Python says of 1if or 0in is no news to whoever wrote a formula
            tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as e:
        raise ExpressionError(e.msg) from e
    except (
        ValueError,
        RecursionError,
        MemoryError,
    ) as e:  # MemoryError: the parser's word for brackets within brackets
        raise ExpressionError("it is nested too deeply") from e
    n_nodes, deepest = 0, 0
    for _, depth in _walk(tree):
        n_nodes, deepest = n_nodes + 1, max(deepest, depth)
        if n_nodes > MOST_NODES:
            raise ExpressionError(
                f"it has more than {MOST_NODES} numbers, names and operators; split it into constants"
            )
        if deepest > DEEPEST:
            raise ExpressionError(f"it is nested more than {DEEPEST} levels deep; sort its terms into brackets")
    names: set[str] = set()
    if _check(tree, names):
        raise ExpressionError("it is a condition, not a number; write where(condition, a, b)")
    return Expression(text, frozenset(names), tree)


def _walk(tree: ast.expr) -> Iterator[tuple[ast.expr, int]]:
    """Every expression within one, and how deep it lies; no recursion, since nothing has been bounded yet."""
    waiting: list[tuple[ast.AST, int]] = [(tree, 1)]
    while waiting:
        node, depth = waiting.pop()
        if isinstance(node, ast.expr):
            yield node, depth
        waiting += [(child, depth + 1) for child in ast.iter_child_nodes(node)]


def _check(node: ast.expr, names: set[str]) -> bool:
    """Whether a part is a condition (else it is a number); adds the names it uses. Raises ExpressionError."""
    match node:
        case ast.Constant(value=value):
            _finite(value)
            return False
        case ast.Name(id=name):
            if name in FUNCTIONS:
                raise ExpressionError(f"{name} is a function; write {name}(…)")
            names.add(name)
            return False
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            _number(operand, names, "a sign")
            return False
        case ast.UnaryOp(op=ast.Invert(), operand=operand):
            _condition(operand, names, "~")
            return True
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            sign = _ARITHMETIC[type(op)][0]
            _number(left, names, sign)
            _number(right, names, sign)
            if isinstance(op, ast.Pow) and abs(_constant(right) or 0.0) > LARGEST_EXPONENT:
                raise ExpressionError(f"{_constant(right):g} is too large an exponent; at most {LARGEST_EXPONENT:g}")
            return False
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BOTH:
            _condition(left, names, "& and |")
            _condition(right, names, "& and |")
            return True
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
            _number(left, names, "a comparison")
            _number(right, names, "a comparison")
            return True
        case ast.Compare(ops=[_, _, *_]):
            raise ExpressionError("a chain of comparisons is not allowed; write (a < b) & (b < c)")
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            _check_call(name, arguments, names)
            return False
    raise ExpressionError(f"{_named(node)} is not allowed in a formula")


def _check_call(name: str, arguments: list[ast.expr], names: set[str]) -> None:
    if name not in FUNCTIONS:
        raise ExpressionError(f"it calls {name}; the functions are {', '.join(FUNCTIONS)}")
    wanted = FUNCTIONS[name][1]
    if len(arguments) != wanted:
        raise ExpressionError(f"{name} takes {wanted} value{'s' * (wanted > 1)}; it is given {len(arguments)}")
    for i, argument in enumerate(arguments):
        if name == "where" and i == 0:
            _condition(argument, names, "the first value of where")
        else:
            _number(argument, names, name)


def _number(node: ast.expr, names: set[str], where: str) -> None:
    if _check(node, names):
        raise ExpressionError(f"{where} takes numbers, not a condition; write where(condition, 1, 0)")


def _condition(node: ast.expr, names: set[str], where: str) -> None:
    if not _check(node, names):
        raise ExpressionError(f"{where} takes a condition in brackets, such as (T > 6.5)")


def _finite(value: object) -> float:
    """A constant as a float: 10**400 and 1e400 are none. Raises ExpressionError."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ExpressionError(f"{value!r} is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ExpressionError("a number is too large for 64 bits")
    return number


def _constant(node: ast.expr) -> float | None:
    """The number that a part is, a sign before it included; None where it is no plain number."""
    match node:
        case ast.Constant(value=value):
            return _finite(value)
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=value)):
            return -_finite(value)
    return None


def _named(node: ast.expr) -> str:
    if isinstance(node, ast.BinOp | ast.UnaryOp):
        signs = {"FloorDiv": "//", "LShift": "<<", "RShift": ">>", "Not": "`not` (write ~ before a condition)"}
        name = type(node.op).__name__
        return signs.get(name, name)
    if isinstance(node, ast.Call):
        return "a call with named values" if node.keywords else "a call of something that is no plain name"
    if isinstance(node, ast.Compare):
        return "`in` or `is`"
    return _CALLED.get(type(node), type(node).__name__)


def _value(node: ast.expr, values: Mapping[str, FloatArray]) -> Any:
    """The value of a checked part: float64, or bool of a condition."""
    match node:
        case ast.Constant(value=value):
            return np.float64(_finite(value))
        case ast.Name(id=name):
            return values[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return np.negative(_value(operand, values))
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _value(operand, values)
        case ast.UnaryOp(operand=operand):
            return np.logical_not(_value(operand, values))
        case ast.BinOp(left=left, op=ast.Pow(), right=right) if _constant(right) is not None:
            return _power(_value(left, values), _constant(right) or 0.0)
        case ast.BinOp(left=left, op=op, right=right):
            does = _BOTH.get(type(op)) or _ARITHMETIC[type(op)][1]
            return does(_value(left, values), _value(right, values))
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _COMPARISONS[type(op)](_value(left, values), _value(right, values))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name][0](*(_value(a, values) for a in arguments))
    raise AssertionError(f"{ast.dump(node)} passed the check")


def _power(base: Any, exponent: float) -> Any:
    """base**exponent; multiplied out, as numexpr did, for whole and half exponents to 50: faster, and bit-identical."""
    if 2.0 * exponent != round(2.0 * exponent) or abs(exponent) > 50.0:
        return np.power(base, exponent)
    result, square, whole = None, base, int(abs(exponent))
    while whole:
        if whole & 1:
            result = square if result is None else result * square
        whole >>= 1
        square = square * square if whole else square
    if abs(exponent) % 1.0:
        root = np.sqrt(base)
        result = root if result is None else result * root
    if result is None:
        return np.ones_like(base)
    return 1.0 / result if exponent < 0.0 else result
