"""Claims about tails: closed forms, coverage of the intervals, where FORM fails, and brute force on the real lot."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import beta as beta_distribution
from scipy.stats import chi2, norm

import by_hand
from examples import in_turn
from softclose import Waveform
from softclose.conditions.streams import Ensemble
from softclose.evaluate import draw, respond
from softclose.evaluate.pieces import Sent, here
from softclose.settings import load_config
from softclose.uncertainty import tails as module
from softclose.uncertainty.tails import TailError, tail

pytest.importorskip("openturns")

DRIVE = Waveform.from_rows([(0.0, 4.0, 3.2, 150.0), (25.0, 20.0, None, 75.0)])
SAMPLING = ("importance", "subset")


@pytest.fixture
def known(monkeypatch):
    """A lot whose V is a stated function of its standard normal coordinates."""

    def use(function):
        monkeypatch.setattr(module, "_lot_at", lambda config, u: u)
        monkeypatch.setattr(module, "_measure", lambda asked, u: (function(u), 0))
        monkeypatch.setattr(
            module,
            "draw",
            lambda config, n, *, seed, start, ensemble: np.random.default_rng((seed, start)).standard_normal((n, 4)),
        )
        return load_config({})

    return use


def plane(u):
    return 10.0 + 2.0 * (u @ np.array([0.5, -0.5, 0.5, 0.5]))


@pytest.mark.parametrize("beta", [2.0, 4.0])
def test_on_a_plane_every_method_finds_the_closed_form(known, beta):
    config = known(plane)
    truth = norm.sf(beta)
    found = tail(config, DRIVE, "fast", limit_cm_s=10.0 + 2.0 * beta, n_switches=400_000)
    by_method = {t.method: t for t in found}
    assert by_method["form"].probability == pytest.approx(truth, rel=1e-3)
    assert by_method["form"].beta == pytest.approx(beta, abs=1e-3)
    np.testing.assert_allclose(by_method["form"].point, beta * np.array([0.5, -0.5, 0.5, 0.5]), atol=1e-2)
    assert by_method["sorm"].probability == pytest.approx(truth, rel=2e-2)
    for method in SAMPLING:
        assert by_method[method].probability == pytest.approx(truth, rel=0.2)
    if beta == 2.0:
        assert by_method["brute"].interval[0] < truth < by_method["brute"].interval[1]


def test_with_two_ways_to_fail_form_sees_one_and_sampling_both(known):
    """|plane|: two most probable points; FORM is out by a half, importance sampling has a part for each."""
    config = known(lambda u: 10.0 + 2.0 * np.abs(u @ np.array([0.5, -0.5, 0.5, 0.5])))
    truth = 2.0 * norm.sf(3.5)
    by_method = {t.method: t for t in tail(config, DRIVE, "fast", limit_cm_s=17.0, methods=("form", *SAMPLING))}
    assert by_method["form"].probability == pytest.approx(0.5 * truth, rel=0.02)
    for method in SAMPLING:
        assert by_method[method].probability == pytest.approx(truth, rel=0.2)


def test_on_a_sphere_form_is_far_out_and_sampling_is_not(known):
    """Everything beyond a distance fails: infinitely many most probable points."""
    config = known(lambda u: np.sqrt((u**2).sum(axis=1)))
    truth = chi2.sf(4.5**2, 4)
    by_method = {t.method: t for t in tail(config, DRIVE, "fast", limit_cm_s=4.5, methods=("form", "subset"))}
    assert by_method["form"].probability < 0.1 * truth
    assert by_method["subset"].probability == pytest.approx(truth, rel=0.25)


def test_where_the_response_jumps_form_says_that_its_point_is_not_on_the_limit(known):
    """A cliff: V is 0 up to it and 30 beyond."""
    config = known(lambda u: np.where(u[:, 0] + u[:, 1] > 4.0, 30.0, 0.0))
    truth = norm.sf(4.0 / math.sqrt(2.0))
    form, importance = tail(config, DRIVE, "fast", limit_cm_s=19.7, methods=("form", "importance"))
    assert form.note
    assert importance.interval[0] < truth < importance.interval[1]


@pytest.mark.parametrize("method", SAMPLING)
def test_intervals_of_sampling_cover(known, method):
    """At 90 %, of 60 seeds, on a curved limit with a closed form: the sum of squares of two coordinates."""
    config = known(lambda u: u[:, 0] ** 2 + u[:, 1] ** 2)
    truth = chi2.sf(18.0, 2)
    found = [
        tail(config, DRIVE, "fast", limit_cm_s=18.0, methods=[method], confidence=0.9, relative_error=0.1, seed=seed)[0]
        for seed in range(60)
    ]
    inside = np.mean([t.interval[0] <= truth <= t.interval[1] for t in found])
    assert inside >= 0.75
    assert np.mean([t.probability for t in found]) == pytest.approx(truth, rel=0.08)


@pytest.mark.parametrize(("p", "repetitions"), [(0.6, 40), (0.08, 40), (0.02, 40), (1e-4, 25)])
def test_the_interval_of_subset_sampling_holds_from_the_first_level_on(known, p, repetitions):
    """Where most fail, and where the first level is most of the error: none to 24 of 30 held."""
    config = known(plane)
    limit = 10.0 + 2.0 * norm.isf(p)
    found = [
        tail(config, DRIVE, "fast", limit_cm_s=limit, methods=["subset"], relative_error=0.25, seed=seed)[0]
        for seed in range(repetitions)
    ]
    inside = np.mean([t.interval[0] <= p <= t.interval[1] for t in found])
    assert inside >= 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / repetitions)


def test_a_limit_that_nothing_reaches_costs_no_other_method_its_row(known):
    config = known(lambda u: 10.0 + 2.0 * np.tanh(u[:, 0]))
    found = {t.method: t for t in tail(config, DRIVE, "fast", limit_cm_s=13.0, n_switches=10_000)}
    assert list(found) == list(module.METHODS)
    assert found["brute"].interval[0] == found["brute"].probability == 0.0 < found["brute"].interval[1]
    assert found["subset"].probability == found["subset"].interval[0] == 0.0
    assert math.isnan(found["subset"].interval[1])
    assert "the lot ends before the limit" in found["subset"].note
    assert all(math.isnan(found[m].probability) and found[m].note for m in ("form", "sorm", "importance"))


@pytest.mark.parametrize("failures", [1, 3, 9])
def test_chains_with_a_variance_below_0_are_drawn_anew_and_cost_no_other_method_its_row(known, monkeypatch, failures):
    """OpenTURNS stops on them, once in some thousand runs."""
    import openturns as ot

    runs = []

    class Contrary:
        def __init__(self, event):
            self.algorithm = ot.SubsetSampling(event)
            self.fails = len(runs) < failures
            runs.append(self)

        def __getattr__(self, name):
            return getattr(self.algorithm, name)

        def run(self):
            self.algorithm.run()
            if self.fails:
                raise TypeError("InvalidArgumentException : The variance estimate must be >= 0")

    config = known(plane)
    monkeypatch.setattr(module, "_openturns", lambda: _Changed(ot, SubsetSampling=Contrary))
    subset, brute = tail(config, DRIVE, "fast", limit_cm_s=16.0, methods=("subset", "brute"), relative_error=0.3)
    assert brute.interval[0] < norm.sf(3.0) < brute.interval[1]
    assert len(runs) == min(failures, 3) + 1, "drawn anew three times at most"
    if failures <= 3:
        assert subset.interval[0] < norm.sf(3.0) < subset.interval[1]
        assert f"drawn {failures + 1} times" in subset.note
        (once,) = tail(config, DRIVE, "fast", limit_cm_s=16.0, methods=("subset",), relative_error=0.3)
        assert subset.n_switches > once.n_switches, "those drawn in vain were simulated"
    else:
        assert math.isnan(subset.probability)
        assert subset.note == "The variance estimate must be >= 0"


class _Changed:
    """A module of which some things are others."""

    def __init__(self, whole, **changes):
        self.__dict__.update(vars(whole), **changes)


# Where failures are looked for, and what is told of them.


def limited(known, function, limit):
    """The space of a lot whose V is a function of its coordinates."""
    return module._Space(known(function), DRIVE, "fast", limit, here)


AXIS = np.array([0.5, -0.5, 0.5, 0.5])


@pytest.mark.parametrize("beta", [2.5, 4.5])
def test_on_a_plane_the_failure_that_is_found_first_is_the_most_probable_one(known, beta):
    """Without a gradient: its distance is the plane's within 2 %, from whichever scouts."""
    space = limited(known, plane, 10.0 + 2.0 * beta)
    for seed in range(5):
        points = module._failure_points(space, seed)
        distances = np.linalg.norm(points, axis=1)
        assert (plane(points) > space.threshold).all()
        assert (np.diff(distances) >= 0.0).all()
        assert beta < distances[0] < 1.02 * beta
        assert points[0] @ AXIS / distances[0] > 0.98


def test_failures_are_looked_for_ever_further_out_and_found_at_seven_standard_deviations(known):
    spreads = []

    def never(u):
        spreads.append(u.std())
        return np.zeros(len(u))

    assert module._failure_points(limited(known, never, 19.7), 0) is None
    assert (np.diff(spreads) > 0.3).all()
    assert len(spreads) > 1
    (form,) = tail(known(plane), DRIVE, "fast", limit_cm_s=10.0 + 2.0 * 7.0, methods=["form"])
    assert form.beta == pytest.approx(7.0, abs=1e-3)


def test_each_direction_of_failure_has_a_point(known):
    """Three walls, two of them opposite ones: the search keeps a point on each, at its distance."""
    distances = np.array([3.0, 3.3, 3.6])
    ways = np.concatenate([-np.eye(4)[:1], np.eye(4)[:2]])

    def walls(u):
        return (u @ ways.T - distances).max(axis=1) + 10.0

    for seed in range(3):
        points = module._failure_points(limited(known, walls, 10.0), seed)
        found = {int(np.argmax(ways @ p)): float(np.linalg.norm(p)) for p in points[::-1]}
        np.testing.assert_allclose([found[i] for i in range(3)], distances, rtol=0.02)
    (form,) = tail(known(walls), DRIVE, "fast", limit_cm_s=10.0, methods=["form"])
    assert form.beta == pytest.approx(3.0, abs=1e-3), "from the nearest one"
    assert not form.note


def test_what_is_at_the_limit_is_no_failure(known):
    """A terrace at the limit itself, half as far out as what lies above it."""

    def terrace(u):
        return np.select([u[:, 0] > 3.0, u[:, 0] > 1.5], [25.0, 19.7], 0.0)

    points = module._failure_points(limited(known, terrace, 19.7), 0)
    assert (points[:, 0] > 3.0).all()
    brute, subset = tail(known(terrace), DRIVE, "fast", methods=("brute", "subset"), n_switches=50_000)
    assert brute.probability < 2.0 * norm.sf(3.0)
    assert subset.probability < 2.0 * norm.sf(3.0)


@pytest.mark.parametrize("way", [AXIS, -AXIS])
def test_in_a_region_as_thin_as_a_needle_the_way_to_the_origin_is_followed(known, way):
    """No random step stays in it; its near end is found within 1 %, wherever it points to."""

    def needle(u):
        return np.where(np.abs(u - np.outer(u @ way, way)).max(axis=1) < 1e-9, u @ way, 0.0)

    space = limited(known, needle, 4.0)
    for far in (4.001, 4.3, 5.0, 9.0, 40.0):
        found = module._nearest(space, far * way, np.random.default_rng(0))
        assert 4.0 < found @ way <= min(far, 4.0 / 0.99)


def test_a_search_never_leaves_what_fails_nor_goes_outwards(known):
    """Where failures are a ball aside of the origin: the nearest is on its near side."""
    centre = 5.0 * AXIS

    def ball(u):
        return 2.0 - np.linalg.norm(u - centre, axis=1)

    space = limited(known, ball, 1.0)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        away = rng.standard_normal(4)
        begin = centre + 0.95 * away / np.linalg.norm(away)
        found = module._nearest(space, begin, rng)
        assert ball(found[None])[0] > 1.0
        assert np.linalg.norm(found) <= np.linalg.norm(begin)
        assert np.linalg.norm(found) == pytest.approx(4.0, rel=0.03)


def test_one_narrow_way_to_fail_is_enough(known):
    """A cone: no two of its failures count as two directions. Its share of the sphere is (a - sin a cos a) / pi."""
    half, beyond = math.radians(18.0), 3.0

    def cone(u):
        r = np.linalg.norm(u, axis=1)
        return np.where(u @ AXIS > math.cos(half) * r, r, 0.0)

    assert len(module._failure_points(limited(known, cone, beyond), 0)) == 1
    truth = chi2.sf(beyond**2, 4) * (half - math.sin(half) * math.cos(half)) / math.pi
    found, form = tail(known(cone), DRIVE, "fast", limit_cm_s=beyond, methods=["importance", "form"])
    assert found.probability == pytest.approx(truth, rel=0.15)
    assert form.beta == pytest.approx(beyond, abs=1e-3)


def test_near_failures_are_drawn_most_and_none_is_left_out(known, monkeypatch):
    import openturns as ot

    mixtures = []
    changed = _Changed(ot, Mixture=lambda *given: mixtures.append(ot.Mixture(*given)) or mixtures[-1])
    space = limited(known, lambda u: np.maximum(u[:, :2].max(axis=1), u[:, 2] - 2.0), 3.0)
    function = ot.PythonFunction(4, 1, func_sample=space)
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(4))), ot.Greater(), 3.0)
    points = np.array([[3.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 5.0, 0.0]])
    found = module._importance(changed, space, event, points, 0.05, 0.95)
    assert found.interval[0] < 2.0 * norm.sf(3.0) < found.interval[1]
    first, second, far, own = mixtures[0].getWeights()
    assert first == pytest.approx(second)
    assert 0.04 < far < 0.15 * first
    assert own == pytest.approx(0.1)
    np.testing.assert_allclose([d.getMean() for d in mixtures[0].getDistributionCollection()], [*points, np.zeros(4)])


@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_the_interval_of_importance_sampling_is_as_wide_as_the_error_that_was_asked_for(known, confidence):
    asked = {"methods": ["importance"], "relative_error": 0.1, "confidence": confidence}
    (found,) = tail(known(plane), DRIVE, "fast", limit_cm_s=16.0, **asked)
    low, high = (abs(math.log(x / found.probability)) for x in found.interval)
    assert low == pytest.approx(high)
    assert 0.3 < low / (0.1 * norm.isf(0.5 - 0.5 * confidence)) <= 1.0


@pytest.mark.parametrize("relative_error", [0.07, 0.1])
def test_subset_sampling_is_as_sure_as_asked_within_what_correlated_chains_may_add(known, relative_error):
    """Four levels at 1e-4; the bound on their sum is less than twice what independent ones would err by."""
    asked = {"methods": ["subset"], "relative_error": relative_error}
    (found,) = tail(known(plane), DRIVE, "fast", limit_cm_s=10.0 + 2.0 * norm.isf(1e-4), **asked)
    width = math.log(found.interval[1] / found.probability) / norm.isf(0.025)
    assert 1.0 < width / relative_error < 2.0


def levels(shares, n, variations):
    """What stands for a run of subset sampling: of each level its share, and the variation up to it."""
    result = SimpleNamespace(getOuterSampling=lambda: n * len(shares), getProbabilityEstimate=lambda: math.prod(shares))
    return SimpleNamespace(
        getResult=lambda: result,
        getStepsNumber=lambda: len(shares),
        getBlockSize=lambda: 1,
        getProbabilityEstimatePerStep=lambda: np.cumprod(shares),
        getCoefficientOfVariationPerStep=lambda: np.array(variations),
    )


def test_subset_sampling_errs_by_its_first_sample_and_by_the_sum_of_its_chains(known):
    """A share p of n is known to sqrt((1 - p) / (p n)); chains of later levels start from one another's."""
    space = limited(known, plane, 16.0)
    z = norm.isf(0.025)

    def width(*given):
        found = module._of_levels(space, levels(*given), 0.95)
        return math.log(found.interval[1] / found.probability)

    for share in (0.1, 0.4):
        assert width([share, 0.2], 5000, [0.0, 0.0]) == pytest.approx(z * math.sqrt((1.0 - share) / (share * 5000)))
    first = math.sqrt(0.9 / (0.1 * 5000))
    found = width([0.1, 0.1, 0.1], 5000, [0.0, 0.03, 0.05])  # levels of 3 % and 4 %: a root of sums of squares of 5 %
    assert found == pytest.approx(z * math.hypot(first, 0.03 + 0.04))
    assert module._of_levels(space, levels([0.9, 0.9], 50, [0.0, 0.2]), 0.95).interval[1] == 1.0
    one = module._of_levels(space, levels([0.02], 4000, [0.0]), 0.95)
    assert one.probability == 0.02
    assert one.interval == pytest.approx(tuple(beta_distribution.ppf([0.025, 0.975], [80, 81], [3921, 3920])))


def test_a_probability_below_the_least_is_none(known):
    """7.5 standard deviations out: 3e-14, which importance sampling could tell and bounds of the lot could not."""
    config = known(plane)
    for t in tail(config, DRIVE, "fast", limit_cm_s=10.0 + 2.0 * 7.5, methods=SAMPLING, relative_error=0.3):
        assert t.probability == t.interval[0] == 0.0
        assert math.isnan(t.interval[1])
        assert "the lot ends before the limit" in t.note


def test_on_a_plane_of_open_switches_form_has_nothing_to_note(known):
    """Open is a value above 0: there what is near the limit is not told in parts of it."""
    for form in tail(known(lambda u: 0.3 * (u @ AXIS - 3.0)), DRIVE, "open", methods=["form", "sorm"]):
        assert not form.note
        assert form.beta == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize(("event", "counted"), [("fast", "not fast"), ("open", "open")])
def test_switches_that_cannot_be_integrated_stand_beside_what_a_method_notes(known, monkeypatch, event, counted):
    """A cliff, on which two switches of every piece fail; each method tells of its own, with or without a reason."""
    config = known(plane)

    def cliff(u):
        return np.where(u[:, 0] + u[:, 1] > 4.0, 30.0, -30.0)

    monkeypatch.setattr(module, "_measure", lambda asked, u: (cliff(u), min(len(u), 2)))
    form, brute, subset = tail(
        config, DRIVE, event, methods=("form", "brute", "subset"), n_switches=100, relative_error=0.3
    )
    assert brute.note == f"2 of 100 switches could not be integrated, counted as {counted}"
    reason, told = form.note.split("; ")
    assert "integrated" not in reason
    assert told.endswith(f" of {form.n_switches:,} switches could not be integrated, counted as {counted}")
    assert subset.note.endswith(f" of {subset.n_switches:,} switches could not be integrated, counted as {counted}")


# The real lot.


def test_brute_force_is_the_share_of_fresh_switches_and_open_ones():
    config = load_config({})
    found = [tail(config, DRIVE, event, methods=["brute"], n_switches=3000, seed=4)[0] for event in ("fast", "open")]
    r = respond(config, draw(config, 3000, seed=4, ensemble=Ensemble.TAIL), DRIVE)
    assert found[0].probability == np.mean(np.nan_to_num(r.max_contact_speed) > 0.197)
    assert found[1].probability == np.mean(~r.closed)
    assert found[0].interval[0] < found[0].probability < found[0].interval[1]


@pytest.mark.parametrize(
    ("event", "measured"),
    in_turn((pytest.param(e, m) for e in ("fast", "open") for m in ("nothing", "pull-in and resonance")), 3),
)
def test_sampling_agrees_with_brute_force_on_the_real_lot(event, measured):
    """Trimmed lots too, whose errors of measurement are coordinates of the space."""
    config = load_config({"trim": {"measured": measured, "pull_in_error": 0.03}})
    limit = {"nothing": 25.0, "pull-in and resonance": 22.0}[measured]
    drive = Waveform.from_rows([(0.0, 6.0, 1.0, 120.0), (24.0, 20.0, None, 72.0)])
    brute, *others = tail(
        config, drive, event, limit_cm_s=limit, methods=("brute", *SAMPLING), n_switches=60_000, relative_error=0.08
    )
    assert 1e-4 < brute.probability < 0.6
    spread = 0.5 * math.log(brute.interval[1] / brute.interval[0])
    for other in others:
        assert abs(math.log(other.probability / brute.probability)) < 3.0 * math.hypot(spread / 2.0, 0.1)


def test_the_same_seed_gives_the_same_numbers():
    config = load_config({})
    a, b = (tail(config, DRIVE, "fast", methods=("importance", "form"), seed=3, relative_error=0.2) for _ in range(2))
    assert a == b or all(x.probability == y.probability for x, y in zip(a, b, strict=True))


def test_a_limit_beyond_the_lot_is_never_met():
    found = tail(load_config({}), DRIVE, "fast", limit_cm_s=500.0, methods=("form", "importance"))
    assert all(math.isnan(t.probability) and "no failure was found" in t.note for t in found)


@pytest.mark.parametrize(
    ("event", "changes", "said"),
    [
        ("slow", {}, "the event is 'slow'; it must be one of fast, open"),
        ("fast", {"methods": ["luck"]}, "'luck' is no method; choose from brute, form"),
        ("fast", {"limit_cm_s": -1.0}, "limit is -1 cm/s; it must be above 0"),
        ("fast", {"limit_cm_s": 0.0}, "limit is 0 cm/s; it must be above 0"),
        ("fast", {"limit_cm_s": math.inf}, "limit is inf cm/s"),
        ("fast", {"n_switches": 0}, "0 switches say nothing"),
        ("fast", {"relative_error": 2.0}, "relative error is 2"),
        ("fast", {"relative_error": 1.0}, "relative error is 1"),
        ("fast", {"relative_error": 0.0}, "relative error is 0"),
        ("fast", {"confidence": 1.0}, "confidence is 1"),
        ("fast", {"confidence": 0.0}, "confidence is 0"),
    ],
)
def test_questions_that_cannot_be_are_refused(event, changes, said):
    with pytest.raises(TailError, match=said):
        tail(load_config({}), DRIVE, event, **changes)


def test_the_least_that_can_be_asked_is_answered(known):
    config = known(lambda u: np.full(len(u), 0.02))
    asked = {"limit_cm_s": 0.01, "n_switches": 1, "relative_error": 0.01, "confidence": 0.01}
    (brute,) = tail(config, DRIVE, "fast", methods=["brute"], **asked)
    assert (brute.probability, brute.n_switches, brute.interval[1]) == (1.0, 1, 1.0)


def test_without_openturns_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openturns", None)
    with pytest.raises(TailError, match=r"pip install openturns, or choose the method brute"):
        tail(load_config({}), DRIVE, "fast", methods=["form"])
    simulated = []
    with pytest.raises(TailError, match="pip install openturns"):
        tail(load_config({}), DRIVE, "fast", methods=["brute", "form"], mapper=lambda *given: simulated.append(given))
    assert not simulated, "it is said before anything is simulated"
    assert tail(load_config({}), DRIVE, "fast", methods=["brute"], n_switches=100)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(["trim.measured=contact times"], marks=pytest.mark.long),
        ["trim.measured=contact times", "amplifier.gain_error=0.02", "amplifier.time_error=0.01"],
    ],
)
def test_sampling_agrees_with_brute_force_where_drives_are_learned(settings):
    """Errors of timing are coordinates like any other: every method sees the lot that brute force sees."""
    config = load_config({}, settings)
    drive = Waveform.from_rows([(0.0, 6.0, 1.0, 120.0), (24.0, 20.0, None, 72.0)])
    brute, other = tail(
        config, drive, "fast", limit_cm_s=20.0, methods=("brute", "importance"), n_switches=20_000, relative_error=0.1
    )
    assert 1e-4 < brute.probability < 0.6
    spread = 0.5 * math.log(brute.interval[1] / brute.interval[0])
    assert abs(math.log(other.probability / brute.probability)) < 3.0 * math.hypot(spread / 2.0, 0.1)


EVERYTHING = {
    "trim": {"measured": "pull-in and resonance"},
    "amplifier": {"gain_error": 0.01, "time_error": 0.01},
    "temperature": {"celsius": [-40, 20, 85], "stiffness": [1.06, 1.0, 0.93], "low_C": -40, "high_C": 85},
}


def test_a_point_of_the_space_is_the_switch_at_those_uniform_numbers():
    """Every condition at once: four variables, two errors of measurement, gain and clock, temperature."""
    config = load_config(EVERYTHING)
    space = module._Space(config, DRIVE, "fast", 19.7, here)
    assert space.dim == 9
    normal = np.random.default_rng(5).standard_normal((6, 9))
    u = norm.cdf(normal)
    keys = (0, by_hand.MEASUREMENT, by_hand.DRIVE, by_hand.TEMPERATURE)
    rows = by_hand.at(config, dict(zip(keys, np.split(u, [4, 6, 8], axis=1), strict=True)))
    alone = by_hand.respond(config, rows, DRIVE).max_contact_speed
    np.testing.assert_allclose(space(normal)[:, 0], 100.0 * np.nan_to_num(alone), rtol=1e-5)
    assert (space.n, space.n_failed) == (6, 0)


def test_a_switch_that_closes_too_late_is_open():
    """closed_by_us counts here as everywhere else; the measure of failure is above 0 just where it does."""
    drive = Waveform.from_rows([(0.0, 4.0, 6.0, 150.0), (25.0, 20.0, None, 80.0)])
    config = load_config({"objective": {"closed_by_us": 90.0}})
    found = tail(config, drive, "open", methods=["brute"], n_switches=2000, seed=4)[0]
    r = respond(config, draw(config, 2000, seed=4, ensemble=Ensemble.TAIL), drive)
    late = ~(r.closed & (r.settling_us <= 90.0))
    assert found.probability == np.mean(late) > np.mean(~r.closed) + 0.05
    asked = module._Asked(Sent(config), drive, "open", 0.0)
    values, n_failed = module._measure(asked, draw(config, 2000, seed=4, ensemble=Ensemble.TAIL))
    np.testing.assert_array_equal(values > 0.0, late)
    np.testing.assert_allclose(90.0 * (1.0 + values[~late]), r.settling_us[~late], err_msg="by how much too early")
    assert n_failed == 0


@pytest.mark.parametrize("volts", [10.0, 30.0])
def test_an_open_switch_is_open_by_the_part_of_its_travel_that_is_missing(volts):
    """Held below pull-in, with a damper: where the spring and the plate's field balance."""
    config = load_config({}, ["model.quality_factor=0.7", "model.horizon_us=400"])
    drive = Waveform.from_rows([(0.0, 4.0, None, volts)])
    space, speed = (module._Space(config, drive, event, 19.7, here) for event in ("open", "fast"))
    (lot,) = module._lot_at(config, np.zeros((1, space.dim))).switches
    travel, gap, stiffness = lot[:3]
    force = 0.5 * 8.854e-6 * config.model.plate_area_um2 * volts**2
    x = brentq(lambda x: stiffness * x - force / (gap - x) ** 2, 0.0, gap / 3.0)
    assert space(np.zeros((1, space.dim)))[0, 0] == pytest.approx(1.0 - x / travel, abs=1e-3)
    assert speed(np.zeros((1, space.dim)))[0, 0] == 0.0, "it never touches"


def test_the_space_of_a_trimmed_lot_has_a_coordinate_for_each_error():
    config = load_config({"trim": {"measured": "pull-in and resonance"}})
    space = module._Space(config, DRIVE, "fast", 19.7, here)
    assert space.dim == 6
    u = np.zeros((3, 6))
    u[1, 4], u[2, 5] = 2.0, 2.0
    lot = module._lot_at(config, u)
    for name in "DGETKM":
        assert len({*lot[name]}) == 1
    a, b = lot["voltage_scale"], lot["time_scale"]
    assert a[1] / a[0] > 1.015  # a pull-in voltage read 2 % too high drives higher
    assert b[2] / b[0] < 0.992  # a frequency read 2 % too high drives faster
    assert abs(a[2] / a[0] - 1.0) < 0.006
