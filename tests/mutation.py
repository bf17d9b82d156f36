"""Owns what a mutant is: one small change of a module's meaning, by the operators of cosmic-ray and two of our own.

Left alone are places where a change means nothing that a test could claim: annotations, decorators (slots, caches),
the wording of errors, and how tables look.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import parso
from cosmic_ray.ast import ast_nodes
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator

Place = tuple[int, int]
"""Line from 1 and column from 0, in characters."""

# cosmic-ray would also try `a >> b` for `a + b` and `a is b` for `a < b`: killed by any test that gets there.
BUILT_IN = (
    *("ReplaceBinaryOperator_Add_Sub", "ReplaceBinaryOperator_Sub_Add", "ReplaceBinaryOperator_Mul_Div"),
    *("ReplaceBinaryOperator_Div_Mul", "ReplaceBinaryOperator_Pow_Mul", "ReplaceBinaryOperator_FloorDiv_Div"),
    *("ReplaceBinaryOperator_Mod_FloorDiv", "ReplaceBinaryOperator_BitOr_BitAnd", "ReplaceBinaryOperator_BitAnd_BitOr"),
    *("ReplaceComparisonOperator_Lt_LtE", "ReplaceComparisonOperator_Lt_GtE", "ReplaceComparisonOperator_LtE_Lt"),
    *("ReplaceComparisonOperator_LtE_Gt", "ReplaceComparisonOperator_Gt_GtE", "ReplaceComparisonOperator_Gt_LtE"),
    *("ReplaceComparisonOperator_GtE_Gt", "ReplaceComparisonOperator_GtE_Lt", "ReplaceComparisonOperator_Eq_NotEq"),
    *("ReplaceComparisonOperator_NotEq_Eq", "ReplaceComparisonOperator_Is_IsNot", "ReplaceComparisonOperator_IsNot_Is"),
    *("ReplaceUnaryOperator_USub_UAdd", "ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_Invert"),
    *("AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd"),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ExceptionReplacer", "NumberReplacer"),
    "ZeroIterationForLoop",
)

APPEARANCE = frozenset(
    {"strict", "justify", "title_justify", "no_wrap", "show_lines", "indent", "complevel", "shuffle", "zlib"}
)
"""Keyword arguments that guard a programming error or change how something looks only."""


class DropKeyword(Operator):  # type: ignore[misc]
    """Leaves a keyword argument out of a call: an option that is silently ignored."""

    def mutation_positions(self, node: parso.tree.NodeOrLeaf) -> Iterator[tuple[Place, Place]]:
        """One place for each `name=value` in a call of a function with more than one argument.

        Not of a class: most are dataclasses here, which refuse to be made without it.
        """
        if node.type != "argument" or node.parent.type != "arglist" or node.children[1] != "=":
            return
        called = node.parent.parent.get_previous_sibling()
        if not called.get_last_leaf().value[0].isupper():
            yield node.start_pos, node.end_pos

    def mutate(self, node: parso.tree.NodeOrLeaf, index: int) -> parso.tree.NodeOrLeaf:
        """The argument becomes an empty unpacking, so that the commas about it stay right."""
        return parso.python.tree.Operator("**{}", node.start_pos, node.get_first_leaf().prefix)

    @classmethod
    def examples(cls) -> tuple[()]:
        """None."""
        return ()


class SwapName(Operator):  # type: ignore[misc]
    """Takes the opposite function: the other extreme, the other quantifier, the other rounding."""

    OPPOSITE = ("min max", "minimum maximum", "nanmin nanmax", "any all", "sin cos", "floor ceil", "argmin argmax")
    TABLE = {a: b for pair in OPPOSITE for a, b in (pair.split(), reversed(pair.split()))}  # noqa: RUF012

    def mutation_positions(self, node: parso.tree.NodeOrLeaf) -> Iterator[tuple[Place, Place]]:
        """One place for each such name."""
        if node.type == "name" and node.value in self.TABLE:
            yield node.start_pos, node.end_pos

    def mutate(self, node: parso.tree.NodeOrLeaf, index: int) -> parso.tree.NodeOrLeaf:
        """The other name."""
        node.value = self.TABLE[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        """None."""
        return ()


@dataclass(frozen=True)
class Mutant:
    """One changed source text."""

    line: int
    """Line of the change."""
    before: str
    """The changed lines as they are, without indentation."""
    after: str
    """The same lines, changed."""
    source: str
    """The whole changed text."""


def mutants(source: str, n: int, seed: int) -> tuple[list[Mutant], int]:
    """n mutants of a module, one a place, and the number of its places.

    Which ones follows from the seed and the text of the changed line alone, so that an edit elsewhere in the module
    leaves the sample as it was.
    """
    left_alone = _spans_left_alone(source)
    candidates: dict[tuple[Place, Place], list[tuple[str, str, Operator, int]]] = {}
    lines = source.splitlines()
    seen: dict[str, int] = {}
    nodes = list(ast_nodes(parso.parse(source)))
    for name, operator in _operators():
        places = [place for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, (start, end) in enumerate(places):
            if any(a <= start and end <= b for a, b in left_alone):
                continue
            if lines[start[0] - 1][start[1] :].startswith(("*,", "TYPE_CHECKING")):  # no product; no run ever
                continue
            text = f"{seed} {name} {lines[start[0] - 1].strip()}"
            seen[text] = seen.get(text, 0) + 1
            key = hashlib.sha256(f"{text} {seen[text]}".encode()).hexdigest()
            candidates.setdefault((start, end), []).append((key, name, operator, occurrence))
    chosen = sorted(min(here, key=lambda c: c[0]) for here in candidates.values())
    found: list[Mutant] = []
    for _, _, operator, occurrence in chosen:
        mutant = _apply(source, operator, occurrence)
        if mutant is not None:
            found.append(mutant)
        if len(found) == n:
            break
    return sorted(found, key=lambda m: (m.line, m.after)), len(candidates)


def _operators() -> Iterator[tuple[str, Operator]]:
    for name in BUILT_IN:
        yield name, get_operator(f"core/{name}")()
    yield "DropKeyword", DropKeyword()
    yield "SwapName", SwapName()


def _apply(source: str, operator: Operator, occurrence: int) -> Mutant | None:
    """The mutant; None where the change leaves the program as it was, or is no Python."""
    changed = mutate_code(source, operator, occurrence)
    if changed is None:
        return None
    try:
        if ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    old, new = source.splitlines(), changed.splitlines()
    blocks = [op for op in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes() if op[0] != "equal"]
    _, a, _, c, _ = blocks[0]
    _, _, b, _, d = blocks[-1]
    return Mutant(line=a + 1, before=_joined(old[a:b]), after=_joined(new[c:d]), source=changed)


def _joined(lines: Iterable[str]) -> str:
    return " ".join(" ".join(lines).split())


def _spans_left_alone(source: str) -> list[tuple[Place, Place]]:
    """Places inside annotations, decorators, raised errors and the keyword arguments of APPEARANCE."""
    lines = source.splitlines()

    def place(line: int, byte: int) -> Place:
        return line, len(lines[line - 1].encode()[:byte].decode())

    def span(node: ast.expr | ast.stmt | ast.keyword) -> tuple[Place, Place]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)

    spans = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            spans += [span(d) for d in node.decorator_list]
        if isinstance(node, ast.FunctionDef) and node.returns is not None:
            spans.append(span(node.returns))
        if isinstance(node, ast.arg) and node.annotation is not None:
            spans.append(span(node.annotation))
        if isinstance(node, ast.AnnAssign):
            spans.append(span(node.annotation))
        if isinstance(node, ast.Raise) or (isinstance(node, ast.keyword) and node.arg in APPEARANCE):
            spans.append(span(node))
    return spans
