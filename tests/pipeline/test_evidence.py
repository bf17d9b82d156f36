"""Claims about the evidence: scikit-learn's numbers, value and gradient."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from softclose.propose.evidence import Evidence


@pytest.fixture
def table():
    rng = np.random.default_rng(1)
    points = rng.random((40, 5))
    return points, np.sin(points @ np.arange(1.0, 6.0)), rng.random(40) * 0.01


def test_value_and_gradient_are_those_of_scikit_learn(table):
    points, y, noise = table
    theta = np.log([1.3, 0.4, 0.6, 0.3, 0.9, 0.5, 0.02])
    kernel = ConstantKernel() * Matern(length_scale=np.ones(5), nu=2.5) + WhiteKernel()
    oracle = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(points, y)
    likelihood, slope = oracle.log_marginal_likelihood(theta, eval_gradient=True)
    value, gradient = Evidence(points, y, noise)(theta)
    assert value == pytest.approx(-likelihood, rel=1e-11)
    np.testing.assert_allclose(gradient, -slope, rtol=1e-9, atol=1e-10)
