"""Claims about scrambled Sobol sequences: bit for bit scipy's, wherever one begins, and scipy stays unimported."""

from __future__ import annotations

import subprocess
import sys
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from examples import examples
from softclose.population.nets import MOST_DIMENSIONS, MOST_POINTS, scrambled_sobol
from softclose.propose.sobol import sobol_points


@settings(max_examples=examples(60), deadline=None)
@given(st.integers(1, MOST_DIMENSIONS), st.integers(0, 3000), st.integers(1, 3000), st.integers(0, 9))
def test_points_are_scipy_s_wherever_a_piece_begins(dim: int, start: int, n: int, seed: int) -> None:
    engine = qmc.Sobol(dim, scramble=True, rng=np.random.default_rng(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the balance of a first draw that is no power of 2
        if start:
            engine.fast_forward(start)
        theirs = engine.random(n)
    np.testing.assert_array_equal(scrambled_sobol(dim, n, np.random.default_rng(seed), start=start), theirs)


@settings(max_examples=examples(30), deadline=None)
@given(st.integers(1, MOST_DIMENSIONS), st.integers(0, 300), st.integers(1, 300), st.integers(0, 9))
def test_points_of_64_bits_are_scipy_s(dim: int, start: int, n: int, seed: int) -> None:
    """As global sensitivity draws them. (scipy 1.17 cannot begin such a sequence later.)"""
    engine = qmc.Sobol(dim, scramble=True, bits=64, rng=np.random.default_rng(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = engine.random(start + n)[start:]
    np.testing.assert_array_equal(scrambled_sobol(dim, n, np.random.default_rng(seed), start=start, bits=64), theirs)


@pytest.mark.long
def test_the_last_points_of_a_sequence_are_scipy_s() -> None:
    engine = qmc.Sobol(4, scramble=True, rng=np.random.default_rng(1))
    engine.fast_forward(MOST_POINTS - 5)
    ours = scrambled_sobol(4, 5, np.random.default_rng(1), start=MOST_POINTS - 5)
    np.testing.assert_array_equal(ours, engine.random(5))


@pytest.mark.parametrize(
    ("dim", "n", "start"), [(0, 1, 0), (MOST_DIMENSIONS + 1, 1, 0), (1, 2, MOST_POINTS - 1), (1, 1, -1)]
)
def test_what_no_sequence_has_is_refused(dim: int, n: int, start: int) -> None:
    with pytest.raises(ValueError, match="sequence"):
        scrambled_sobol(dim, n, np.random.default_rng(0), start=start)


@pytest.mark.parametrize("dim", [3, MOST_DIMENSIONS + 3])
def test_designs_of_any_dimension_are_scipy_s(dim: int) -> None:
    theirs = qmc.Sobol(dim, scramble=True, rng=np.random.default_rng(5)).random_base2(5)
    np.testing.assert_array_equal(sobol_points(dim, 20, np.random.default_rng(5)), theirs[:20])
    assert sobol_points(dim, 1, np.random.default_rng(5)).shape == (1, dim)


def test_a_campaign_in_this_process_imports_no_distributions_of_scipy() -> None:
    """They take a second, in every process."""
    code = (
        "import sys, softclose_workflows.run.driving\n"
        "from softclose.settings import load_config\n"
        "from softclose.evaluate import draw\n"
        "draw(load_config('current-three'), 64, seed=1, sampling='replicated')\n"
        "assert 'scipy.stats' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


def test_the_design_of_a_search_imports_no_process() -> None:
    """skopt brings sklearn, pandas and the distributions of scipy: as long as a small campaign takes as a whole."""
    code = (
        "import sys\n"
        "from softclose.propose.plan import plan\n"
        "from softclose.propose.proposer import Proposer\n"
        "from softclose.propose.protocol import Problem\n"
        "from softclose.settings import load_config\n"
        "settings = ['prior.model=none', 'campaign.budget=12', 'optimiser.n_initial=12', 'population.n_switches=16']\n"
        "problem = Problem(load_config('current', settings))\n"
        "assert len(Proposer(problem).propose(plan(problem)[0], [], [])) == 12\n"
        "assert not {'skopt', 'sklearn', 'pandas', 'scipy.stats'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
