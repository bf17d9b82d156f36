"""Owns how the parameters of a switch hang together: a Gaussian copula with given rank correlations.

Two variables of rank correlation ρ (Spearman's) are the quantiles of two normal ones of correlation 2 sin(π ρ / 6)
(Pearson 1907): the distributions stay as they are, only who meets whom changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.population.distributions import PopulationError

Correlation = tuple[str, str, float]
"""Two variables and their rank correlation."""

_N_NODES = 48


def check(correlation: Sequence[Correlation], variables: Sequence[str]) -> None:
    """Raises PopulationError where there is no such joint distribution."""
    seen: set[frozenset[str]] = set()
    for a, b, rho in correlation:
        for name in (a, b):
            if name not in variables:
                raise PopulationError(f"a correlation names {name!r}; it must be one of {', '.join(variables)}")
        if a == b:
            raise PopulationError(f"a correlation of {a} with itself says nothing: remove it")
        if frozenset((a, b)) in seen:
            raise PopulationError(f"the correlation of {a} and {b} is given twice: keep one")
        seen.add(frozenset((a, b)))
        if not -1.0 < rho < 1.0:
            raise PopulationError(f"the rank correlation of {a} and {b} is {rho:g}; it must lie between -1 and 1")
    if np.linalg.eigvalsh(matrix(correlation, variables)).min() <= 1e-9:
        raise PopulationError(
            "no switches have these correlations together (their matrix is not positive definite): weaken one of them"
        )


def matrix(correlation: Sequence[Correlation], variables: Sequence[str]) -> FloatArray:
    """(d, d) correlations of the normal variables."""
    found = np.eye(len(variables))
    for a, b, rho in correlation:
        i, j = variables.index(a), variables.index(b)
        found[i, j] = found[j, i] = 2.0 * math.sin(math.pi * rho / 6.0)
    return found


def joined(p: FloatArray, correlation: Sequence[Correlation], variables: Sequence[str]) -> FloatArray:
    """Independent uniforms made dependent. p: (n, d) in [0, 1]; the first variable keeps its own."""
    if not correlation:
        return p
    from scipy.special import ndtr, ndtri  # here: most populations need none of it, and it is slow to import

    factor = np.round(np.linalg.cholesky(matrix(correlation, variables)), 12)
    z = ndtri(np.clip(p, 1e-15, 1.0 - 1e-15))
    out = np.empty_like(p)
    for i in range(p.shape[1]):
        # Column by column, not by matrix: bit-identical for one row and for many.
        total = factor[i, 0] * z[:, 0]
        for j in range(1, i + 1):
            total = total + factor[i, j] * z[:, j]
        out[:, i] = ndtr(total)
    return out


def expect(
    f: Callable[[FloatArray, FloatArray], FloatArray],
    quantiles: tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]],
    rho: float,
) -> float:
    """E[f(x, y)] of two variables of this rank correlation, by Gauss-Hermite quadrature."""
    from scipy.special import ndtr

    nodes, weights = np.polynomial.hermite_e.hermegauss(_N_NODES)
    weights = weights / weights.sum()
    r = 2.0 * math.sin(math.pi * rho / 6.0)
    x, y = np.meshgrid(nodes, nodes, indexing="ij")
    second = ndtr(r * x + math.sqrt(1.0 - r * r) * y)
    values = f(quantiles[0](ndtr(x).ravel()), quantiles[1](second.ravel()))
    return float(np.outer(weights, weights).ravel() @ values)
