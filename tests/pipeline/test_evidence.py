"""Claims about the evidence: scikit-learn's numbers, value and gradient."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from softclose.propose.evidence import Evidence
from softclose.propose.surrogate import Screened, Surrogate, fit


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


def test_points_taken_on_trust_are_those_of_a_process_that_was_given_them(table):
    """Kriging believer: the factor grows by a row, the means stay, and no hyperparameter moves."""
    points, y, _ = table
    rng = np.random.default_rng(2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = fit(points, y, 20)
    screened = Screened(model, rng.random((30, 5)), rng.random((30, 5)))
    lies = rng.random((3, 5))
    expected = model.predict(lies)
    screened.believe(lies[0])
    screened.join(Screened(model, screened.points[:4], screened.inputs[:4]))
    for lie in lies[1:]:
        screened.believe(lie)
    given = Surrogate(model.kernel_, alpha=model.noise_ + 1e-8, optimizer=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # skopt has taken the noise out of the kernel: its logarithm is -inf
        given.fit(np.concatenate([points, lies]), np.concatenate([y, expected]))
    mean, sd = given.predict(screened.inputs, return_std=True)
    found = screened.predict(None)
    np.testing.assert_allclose(found[0], mean, atol=1e-7)
    np.testing.assert_allclose(found[1], sd, atol=1e-7)
    np.testing.assert_allclose(screened.improvement(0.1)[:4], screened.improvement(0.1)[30:], atol=1e-12)
