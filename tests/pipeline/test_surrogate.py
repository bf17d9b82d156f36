"""Claims about the surrogate: scikit-learn's predictions, points taken on trust, and what it is given to learn from."""

from __future__ import annotations

import inspect
import math
import warnings

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from bowl import problem_of
from softclose.propose.surrogate import (
    JITTER,
    Screened,
    Surrogate,
    clipped,
    fit,
    logarithmic,
    of_logarithm,
    surrogate_inputs,
)
from softclose.propose.swing import FARTHEST, free_swing


@pytest.fixture(scope="module")
def table():
    rng = np.random.default_rng(1)
    points = rng.random((40, 5))
    return points, np.sin(points @ np.arange(1.0, 6.0)) + 0.05 * rng.standard_normal(40)


def fitted(points, y, n_iterations=20, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # skopt has taken the noise out of the kernel: its logarithm is -inf
        return fit(points, y, n_iterations, **options)


def hyper(model):
    """Amplitude, length scales and noise variance."""
    found = model.kernel_.get_params()
    return found["k1__k1__constant_value"], found["k1__k2__length_scale"], model.noise_


def oracle(model, points, y):
    """scikit-learn's own process with the same hyperparameters."""
    amplitude, scales, noise = hyper(model)
    kernel = ConstantKernel(amplitude) * Matern(length_scale=scales, nu=2.5)
    return GaussianProcessRegressor(kernel, alpha=noise + JITTER, optimizer=None).fit(points, y)


# Predictions.


@pytest.mark.parametrize("n_fit", [40, 25])
def test_mean_and_deviation_are_those_of_scikit_learn(table, n_fit):
    """Where fewer points than there are set the hyperparameters, all of them still predict."""
    points, y = table
    model = fitted(points, y, n_fit=n_fit)
    at = np.random.default_rng(3).random((60, 5))
    expected = oracle(model, points, y).predict(at, return_std=True)
    for found in (model.predict(at, return_std=True), Screened(model, at, at).predict(at)):
        np.testing.assert_allclose(found[0], expected[0], atol=1e-9)
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-6)
    np.testing.assert_allclose(model.predict(at), expected[0], atol=1e-9)
    assert model.noise_ > 0.0


def test_the_covariance_is_the_matern_kernel(table):
    points, y = table
    model = fitted(points, y)
    amplitude, scales, _ = hyper(model)
    expected = amplitude * Matern(length_scale=scales, nu=2.5)(points[:7], points)
    np.testing.assert_allclose(model.covariance(points[:7], points), expected, rtol=1e-12)


def test_a_prediction_without_deviation_is_skopt_s_own(table):
    points, y = table
    model = fitted(points, y)
    mean, sd, slope = model.predict(points[:1], return_std=True, return_mean_grad=True)
    assert (mean, sd) == pytest.approx(tuple(x[0] for x in model.predict(points[:1], return_std=True)), rel=1e-6)
    assert slope.shape == (5,)


def test_points_taken_on_trust_are_those_of_a_process_that_was_given_them(table):
    """Kriging believer: the factor grows by a row, the means stay, and no hyperparameter moves."""
    points, y = table
    rng = np.random.default_rng(2)
    model = fitted(points, y)
    screened = Screened(model, rng.random((30, 5)), rng.random((30, 5)))
    lies = rng.random((3, 5))
    expected = model.predict(lies)
    given = oracle(model, np.concatenate([points, lies]), np.concatenate([y, expected]))
    screened.believe(lies[0])
    screened.join(Screened(model, screened.points[:4], screened.inputs[:4]))
    for lie in lies[1:]:
        screened.believe(lie)
    mean, sd = given.predict(screened.inputs, return_std=True)
    found = screened.predict(None)
    np.testing.assert_allclose(found[0], mean, atol=1e-8)
    np.testing.assert_allclose(found[1], sd, rtol=1e-6)
    np.testing.assert_allclose(screened.improvement(0.1)[:4], screened.improvement(0.1)[30:], atol=1e-12)
    np.testing.assert_array_equal(screened.points[:4], screened.points[30:])


def test_a_point_believed_twice_leaves_a_factor_that_can_be_used(table):
    """Without noise a repeated point has no variance left: the jitter keeps the factor invertible."""
    points, _ = table
    model = Surrogate(1.0 * Matern(length_scale=np.ones(5), nu=2.5) + WhiteKernel(1e-12), alpha=JITTER, optimizer=None)
    model.kernel = ConstantKernel(1.0) * Matern(length_scale=np.ones(5), nu=2.5) + WhiteKernel(1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(points, points[:, 0])
    model.noise_ = None
    for _ in range(3):
        row = model.believe(points[0])
    assert row[-1] >= math.sqrt(JITTER) * 0.999
    assert np.isfinite(model.predict(points[:3], return_std=True)[1]).all()


def test_expected_improvement_is_the_closed_form(table):
    points, y = table
    screened = Screened(fitted(points, y), points[:9], points[:9])
    mean, sd = screened.predict(None)
    z = (0.2 - mean) / sd
    expected = (0.2 - mean) * norm.cdf(z) + sd * norm.pdf(z)
    np.testing.assert_allclose(screened.improvement(0.2), expected, rtol=1e-9, atol=1e-15)


# Hyperparameters.


def test_hyperparameters_are_the_most_probable_ones(table):
    """The same maximum a posteriori by scikit-learn's likelihood, scipy's priors' sum and a derivative-free search."""
    points, y = table
    amplitude, scales, noise = hyper(fitted(points, y, 200))
    found = np.log([amplitude, *scales, noise])
    kernel = ConstantKernel() * Matern(length_scale=np.ones(5), nu=2.5) + WhiteKernel()
    process = GaussianProcessRegressor(kernel, alpha=JITTER, optimizer=None).fit(points, y)
    centre, width = np.log([1.0, *[0.5] * 5, 1e-3]), np.array([1.0, *[0.8] * 5, 2.0])
    first = np.log(np.hstack(hyper(fitted(points, y, 1))))

    def posterior(theta):
        likelihood = process.log_marginal_likelihood(theta, clone_kernel=False)
        return -likelihood - norm.logpdf(theta, centre, width).sum()

    bounds = np.log([(0.05, 50.0), *[(0.05, 4.0)] * 5, (1e-6, 0.2)])
    best = minimize(posterior, centre, method="L-BFGS-B", bounds=bounds, options={"maxiter": 500})
    assert posterior(found) <= best.fun + 1e-3
    np.testing.assert_allclose(found, best.x, atol=0.05)
    step = minimize(posterior, centre, method="L-BFGS-B", bounds=bounds, options={"maxiter": 1})
    np.testing.assert_allclose(first, step.x, atol=1e-4)


@pytest.mark.parametrize(
    ("scale", "place", "bound"), [(1e4, 0, 50.0), (1e-4, 0, 0.05)], ids=["amplitude above", "amplitude below"]
)
def test_the_amplitude_stays_within_bounds(table, scale, place, bound):
    points, y = table
    assert hyper(fitted(points, y * scale, 200))[place] == pytest.approx(bound, rel=1e-3)


def test_length_scales_and_noise_stay_within_bounds():
    """An input on which nothing depends, one that wriggles faster than anything is learnt of, pure noise, and none."""
    rng = np.random.default_rng(4)
    points = rng.random((60, 2))
    smooth = hyper(fitted(points, 30.0 * points[:, 0] ** 2, 400))
    wild = hyper(fitted(points, np.tile([-10.0, 10.0], 30)[np.argsort(np.argsort(points[:, 0]))], 400))
    assert smooth[1].max() == pytest.approx(4.0)
    assert smooth[2] == pytest.approx(1e-6)
    np.testing.assert_allclose(wild[1], 0.05)
    assert hyper(fitted(points, rng.standard_normal(60), 200))[2] == pytest.approx(0.2, rel=1e-3)


def test_only_the_points_near_the_centre_set_the_hyperparameters(table):
    """Nearest to the best of them, or to the centre that is given."""
    points, y = table
    for centre, around in ((None, points[np.argmin(y)]), (points[7], points[7])):
        near = np.argsort(((points - around) ** 2).sum(axis=1), kind="stable")[:20]
        some = fitted(points[near], y[near], centre=around)
        assert hyper(some)[0] == pytest.approx(hyper(fitted(points, y, centre=centre, n_fit=20))[0], rel=1e-9)


def test_predictions_ask_for_a_deviation_where_skopt_does_not_say():
    """What skopt's acquisition functions call."""
    assert inspect.signature(Screened.predict).parameters["return_std"].default is True


# What it is given.


def test_the_logarithm_keeps_the_order_and_tells_what_one_cm_s_is():
    g = np.array([12.0, 14.0, 16.0, 90.0, 13.0])
    y, unit = logarithmic(g)
    scale = 0.25 * (14.0 - 12.0)
    raw = np.log1p((g - 12.0) / scale)
    np.testing.assert_allclose(y, (raw - raw.mean()) / raw.std())
    step = (np.log1p(1e-6 / scale)) / raw.std() / 1e-6
    assert unit == pytest.approx(step, rel=1e-5)


def test_the_logarithm_of_equal_values_says_nothing():
    y, unit = logarithmic(np.full(5, 14.0))
    np.testing.assert_allclose(y, 0.0)
    assert unit == pytest.approx(1e3 / 1e-9)


def test_what_is_far_above_the_median_is_cut_off():
    g = np.array([12.0, 14.0, 16.0, 90.0, 13.0])
    y, unit = clipped(g)
    cut = np.array([12.0, 14.0, 16.0, 16.0, 13.0])
    np.testing.assert_allclose(y, (cut - cut.mean()) / cut.std())
    assert unit == pytest.approx(1.0 / cut.std())


def test_the_cut_stays_above_the_best_where_the_median_is_the_best():
    y, _ = clipped(np.array([12.0, 12.0, 12.0, 90.0]))
    cut = np.array([0.0, 0.0, 0.0, 1e-3])
    np.testing.assert_allclose(y, (cut - cut.mean()) / cut.std(), rtol=1e-6)


def test_inputs_are_coordinates_and_the_free_swing():
    problem = problem_of()
    points = np.random.default_rng(6).random((300, problem.space.dim))
    inputs = surrogate_inputs(problem, points)
    rows = problem.space.rows(points)
    swing = free_swing(rows, problem.lot, instant_us=rows[:, -1, 0])
    np.testing.assert_array_equal(inputs[:, :-4], points)
    reach, scatter, x, v = inputs[:, -4:].T
    np.testing.assert_allclose(reach * FARTHEST, swing.mean)
    np.testing.assert_allclose(30.0 ** (scatter - 1.2), swing.sd + 0.01)
    inside = np.abs(swing.v[:, 0]) <= FARTHEST
    np.testing.assert_allclose(2.0 * FARTHEST * (v[inside] - 0.5), swing.v[inside, 0], atol=1e-12)
    np.testing.assert_allclose(2.0 * FARTHEST * (x - 0.5), np.clip(swing.x[:, 0], -FARTHEST, FARTHEST), atol=1e-12)
    assert set(v[~inside]) <= {0.0, 1.0}
    assert (~inside).any()
    assert (x == 1.0).any()


@pytest.mark.parametrize(("mean", "sd"), [(-1.0, 0.1), (0.0, 0.5), (1.2, 0.05)])
def test_mean_and_deviation_of_g_itself_are_those_of_a_sample(mean, sd):
    g = 15.0 + np.random.default_rng(2).gamma(2.0, 3.0, 60)
    y, _ = logarithmic(g)
    sample = mean + sd * np.random.default_rng(3).standard_normal(200_000)
    best, scale = g.min(), 0.25 * (np.median(g) - g.min())
    raw = np.log1p((g - best) / scale)
    of_sample = best + scale * np.expm1(sample * raw.std() + raw.mean())
    expected, deviation = of_logarithm(g, np.array([mean]), np.array([sd]))
    assert expected[0] == pytest.approx(of_sample.mean(), abs=0.01 * of_sample.std() + 1e-6)
    assert deviation[0] == pytest.approx(of_sample.std(), rel=0.02)
    certain, none = of_logarithm(g, y, np.zeros(60))
    np.testing.assert_allclose(certain, g, rtol=1e-9)
    assert not none.any()
