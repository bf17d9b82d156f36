"""Owns the population of switches: four parameters, and samples of it keyed by (seed, stream, index).

D and G, and two that give K and M: E and T of a plate (Eqs. 4-6), or what a company knows of its own switch. They are
independent but for the correlations that are given.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic.dataclasses import dataclass

from softclose.allowed.tables import TABLE, checked, refuses_with
from softclose.arrays import FloatArray
from softclose.glance import as_table, as_text
from softclose.metrics.replicates import REPLICATES
from softclose.population import copula
from softclose.population.copula import Correlation
from softclose.population.distributions import Area, PopulationError, portable
from softclose.population.formula import Formula
from softclose.population.laws import LAWS, Law
from softclose.population.laws import UNITS as UNITS
from softclose.population.marginals import Marginal
from softclose.population.nets import MOST_POINTS, scrambled_sobol
from softclose.switch.plate import A1, OtherAreaError, Switches, mass, plate_area_of, pull_in_voltage, stiffness

Sampling = Literal["monte-carlo", "sobol", "replicated"]

SAMPLINGS: tuple[str, ...] = ("monte-carlo", "sobol", "replicated")
VARIABLES = ("D", "G", "E", "T")
_N_MOMENTS = 2**14


@refuses_with(PopulationError)
@dataclass(frozen=True, slots=True, kw_only=True, repr=False, config=TABLE)
class Population:
    """Joint distribution of the parameters of a switch."""

    name: str
    """What reports call it."""
    D: Marginal
    """Travel to contact [µm]."""
    G: Marginal
    """Electrostatic gap [µm]."""
    E: Marginal | None = None
    """Elastic modulus [GPa], with T."""
    T: Marginal | None = None
    """Plate thickness [µm]; K and M follow from E and T by Eqs. 4-6."""
    K: Marginal | None = None
    """Stiffness [N/m] itself, with M or f."""
    M: Marginal | None = None
    """Mass [µg]."""
    f: Marginal | None = None
    """First resonance [kHz], M = K / (2 pi f)²."""
    U_pi: Marginal | None = None
    """Pull-in voltage [V], with f: K follows from it and G by Eq. 3."""
    description: str = ""
    """One sentence for people."""
    plate_area_um2: Area | None = None
    """Plate area [µm²] under which E was inferred from pull-in voltages; None: E rests on no area."""
    correlation: tuple[Correlation, ...] = ()
    """Rank correlations of pairs of variables, in a Gaussian copula; pairs that are not named are independent."""
    formula: Formula | None = None
    """K and M as formulas of E, T and G, in the place of Eqs. 4 and 6."""

    def __post_init__(self) -> None:
        given = tuple(v for v in UNITS if v not in ("D", "G") and getattr(self, v) is not None)
        if not any(set(given) == set(pair) for pair in LAWS):
            pairs = ", ".join(" and ".join(pair) for pair in LAWS)
            raise PopulationError(f"a lot has {', '.join(given) or 'nothing'} beside D and G; give one pair of {pairs}")
        if self.formula is not None and set(given) != {"E", "T"}:
            raise PopulationError(f"[law] says how K and M follow from E and T, and the lot has {' and '.join(given)}")
        if self.law.rests_on_area and self.plate_area_um2 is None:
            raise PopulationError("K follows from U_pi by the plate's area: give plate_area_um2")
        for variable in self.variables:
            lower = getattr(self, variable).lower
            if lower <= 0.0:
                raise PopulationError(f"{variable} reaches down to {lower:g} {UNITS[variable]}; it must stay above 0")
        if self.T is not None and self.formula is None and self.T.lower <= A1:
            raise PopulationError(
                f"T reaches down to {self.T.lower:g} µm; Eq. 4 has no stiffness at or below {A1} µm "
                "(it was fitted to plates 5 to 9 µm thick)"
            )
        copula.check(self.correlation, self.variables)
        if self.formula is not None:
            self.extremes()  # positive at all ends of the ranges
        if self.D.upper >= self.G.lower:
            raise PopulationError(
                f"D reaches up to {self.D.upper:g} µm and G down to {self.G.lower:g} µm; every switch needs D < G: "
                "narrow their bounds or move their means apart"
            )

    @property
    def law(self) -> Law:
        """How K and M follow from what is given."""
        if self.formula is not None:
            return self.formula.law
        return LAWS[next(pair for pair in LAWS if all(getattr(self, v) is not None for v in pair))]

    def _lines(self) -> list[tuple[str, str]]:
        units = {"D": "µm", "G": "µm", "T": "µm", "E": "GPa", "K": "N/m", "M": "µg", "f": "kHz", "U_pi": "V"}
        found = []
        for name in self.variables:
            marginal = getattr(self, name)
            found.append(
                (name, f"{marginal.lower:.4g}–{marginal.upper:.4g} {units.get(name, '')}, mean {marginal.mean:.4g}")
            )
        return found

    def __repr__(self) -> str:
        return as_text(f"Population {self.name}", self._lines())

    def _repr_html_(self) -> str:
        return as_table(f"Population {self.name}", self._lines())

    @property
    def variables(self) -> tuple[str, ...]:
        """The four variables of the lot, in the order of their columns."""
        return ("D", "G", *self.law.variables)

    def marginals(self) -> tuple[Marginal, ...]:
        """Their distributions."""
        return tuple(getattr(self, v) for v in self.variables)

    def switches(self, parameters: ArrayLike) -> FloatArray:
        """Switches of given parameters.

        Parameters
        ----------
        parameters : (n, 4) array-like
            Columns as `variables`.

        Returns
        -------
        (n, 4) ndarray of float64
            Columns D, G [µm], K [N/m], M [µg].
        """
        p = np.asarray(parameters, dtype=np.float64)
        if self._plate is not None:
            return switches_from_parameters(p)
        if p.ndim != 2 or p.shape[1] != 4:
            raise PopulationError(
                f"parameters have shape {p.shape}; expected (n, 4): columns {', '.join(self.variables)}"
            )
        k, m = self.law.switch(p[:, 1], p[:, 2], p[:, 3], self.plate_area())
        return np.stack([p[:, 0], p[:, 1], k, m], axis=1)

    def plate_area(self, asked_um2: float | None = None) -> float:
        """Plate area to use with this population: its own, else what is asked for, else that of Table 1.

        Parameters
        ----------
        asked_um2 : float, optional
            What is asked for [µm²].

        Returns
        -------
        float
            Plate area [µm²].

        Raises
        ------
        PopulationError
            Where both are given and differ: E from another area means other switches.
        """
        try:
            return plate_area_of(self, asked_um2)
        except OtherAreaError as e:
            raise PopulationError(
                f"the plate area is given as {asked_um2:g} µm², but population {self.name!r} was fitted with "
                f"{self.plate_area_um2:g} µm²: leave it out (model.plate_area_um2, --plate-area), or calibrate again "
                "with the other area"
            ) from e

    def sample(
        self, n: int, *, seed: int, sampling: Sampling = "monte-carlo", start: int = 0, stream: int = 0
    ) -> FloatArray:
        """Draw switches `start` to `start + n` of the ensemble `seed`.

        Row i depends on (seed, stream, start + i) and nothing else: a longer ensemble begins with the shorter one, and
        ensembles can be drawn in pieces.

        Parameters
        ----------
        n : int
            Number of switches.
        seed : int
            Which ensemble.
        sampling : {"monte-carlo", "sobol", "replicated"}
            How the unit cube is filled. "replicated": switch i is point i // R of scrambling i mod R, of R independent
            ones (`softclose.metrics.replicates`). One "sobol" sample has no intervals.
        start : int
            Index of the first switch.
        stream : int
            Independent sequence of the seed, such as that of the certificates.

        Returns
        -------
        (n, 4) ndarray of float64
            Columns D, G [µm], K [N/m], M [µg]; with the population's own plate area, where it has one (`Switches`).
        """
        table = self.switches(self.sample_parameters(n, seed=seed, sampling=sampling, start=start, stream=stream))
        return table if self.plate_area_um2 is None else Switches.of(table, self.plate_area_um2)

    def sample_parameters(
        self, n: int, *, seed: int, sampling: Sampling = "monte-carlo", start: int = 0, stream: int = 0
    ) -> FloatArray:
        """The same ensemble as `sample`, by its parameters.

        Parameters
        ----------
        n, seed, sampling, start, stream
            See `sample`.

        Returns
        -------
        (n, 4) ndarray of float64
            Columns as `variables`: D, G [µm], E [GPa], T [µm] of a plate.
        """
        return self.quantile(self.uniforms(n, seed=seed, sampling=sampling, start=start, stream=stream))

    def uniforms(
        self, n: int, *, seed: int, sampling: Sampling = "monte-carlo", start: int = 0, stream: int = 0
    ) -> FloatArray:
        """Points of the unit cube that `sample` maps to switches.

        Parameters
        ----------
        n, seed, sampling, start, stream
            See `sample`.

        Returns
        -------
        (n, 4) ndarray of float64
            Uniform numbers in [0, 1), columns as `variables`.
        """
        return _uniforms(n, seed=seed, sampling=sampling, start=start, stream=stream)

    def with_means(self, means: Mapping[str, float]) -> Population:
        """The same lot about other nominal values (Eq. 14).

        Parameters
        ----------
        means : mapping
            Variable -> its mean; all of its distribution is scaled with it.

        Raises
        ------
        PopulationError
            For a variable that the lot has not, or a mean that it cannot have.
        """
        changed = {}
        for v, mean in means.items():
            if v not in self.variables:
                raise PopulationError(f"the design names {v}; the lot {self.name!r} has {', '.join(self.variables)}")
            marginal = getattr(self, v)
            changed[v] = marginal.shift_mean(float(mean) - marginal.mean)
        return replace(self, **changed)

    def quantile(self, p: FloatArray) -> FloatArray:
        """Map points of the unit cube to parameters.

        Parameters
        ----------
        p : (n, 4) ndarray of float64
            Probabilities in [0, 1].

        Returns
        -------
        (n, 4) ndarray of float64
            Columns as `variables`.

        Raises
        ------
        PopulationError
            For another shape or values outside [0, 1].
        """
        try:
            p = np.asarray(p, dtype=np.float64)
        except (TypeError, ValueError) as e:
            raise PopulationError(
                f"probabilities cannot be read as numbers ({e}); give an (n, 4) array in [0, 1]"
            ) from e
        if p.ndim != 2 or p.shape[1] != len(VARIABLES) or not ((p >= 0.0) & (p <= 1.0)).all():
            raise PopulationError(
                f"probabilities of shape {p.shape}; give an (n, 4) array in [0, 1], for {', '.join(self.variables)}"
            )
        p = copula.joined(p, self.correlation, self.variables)
        columns = [marginal.quantile(p[:, i]) for i, marginal in enumerate(self.marginals())]
        return np.stack(columns, axis=1)

    def _expect(self, f: Callable[[FloatArray], FloatArray]) -> float:
        """E[f(K, M as columns of (n, 2))], over all variables that K and M follow from."""
        first, second = (getattr(self, v) for v in self.law.variables)
        area = self.plate_area()

        def of_pair(g: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
            k, m = self.law.switch(g, a, b, area)
            return f(np.stack(np.broadcast_arrays(k, m), axis=-1))

        if not self.law.rests_on_gap:
            return copula.expect(
                lambda a, b: of_pair(np.ones_like(a), a, b), (first.quantile, second.quantile), self._correlated
            )
        # K follows from G too, and all three may be correlated: a fixed quasi-random sample of them.
        p = self.sample_parameters(_N_MOMENTS, seed=0, sampling="sobol")
        return float(np.mean(of_pair(p[:, 1], p[:, 2], p[:, 3])))

    @property
    def _plate(self) -> tuple[Marginal, Marginal] | None:
        """E and T where Eqs. 4-6 hold."""
        return (self.E, self.T) if self.E is not None and self.T is not None and self.formula is None else None

    @property
    def _correlated(self) -> float:
        pair = set(self.law.variables)
        return next((rho for a, b, rho in self.correlation if {a, b} == pair), 0.0)

    @property
    def mean_K(self) -> float:
        """E[K] [N/m]: Eq. 4 is linear in E, which is independent of T unless a correlation says otherwise."""
        if self._plate is not None and not self._correlated:
            e, t = self._plate
            return portable(t.expect(lambda x: stiffness(e.mean, x)))
        return self.K.mean if self.K is not None else portable(self._expect(lambda km: km[..., 0]))

    @property
    def mean_M(self) -> float:
        """E[M] [µg]."""
        if self._plate is not None:
            return portable(self._plate[1].expect(mass))
        return self.M.mean if self.M is not None else portable(self._expect(lambda km: km[..., 1]))

    @property
    def mean_switch(self) -> FloatArray:
        """The deterministic switch: (4,) E[D], E[G] [µm], E[K] [N/m], E[M] [µg] (paper §4.1)."""
        return np.array([self.D.mean, self.G.mean, self.mean_K, self.mean_M])

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """(8,) K [N/m] and (8,) M [µg] at all ends of the ranges that they follow from."""
        sides = [(x.lower, x.upper) for x in self.marginals()[1:]]
        g, a, b = np.array(list(itertools.product(*sides))).T
        return self.law.switch(g, a, b, self.plate_area())

    def summary(self, plate_area_um2: float | None = None) -> dict[str, float]:
        """Ranges, means and standard deviations, named `quantity_unit`; ranges are those of the bounds.

        Parameters
        ----------
        plate_area_um2 : float, optional
            See `plate_area`.

        Returns
        -------
        dict of str to float
            Such as `D_um_mean`.
        """
        plate_area_um2 = self.plate_area(plate_area_um2)
        d, g = self.D, self.G
        ks, ms = self.extremes()
        if self.U_pi is not None:
            u_pi = np.array([self.U_pi.lower, self.U_pi.upper])
        else:
            corners = np.array([[d.lower, g.lower, ks.min(), 1.0], [d.upper, g.upper, ks.max(), 1.0]])
            u_pi = pull_in_voltage(corners, plate_area_um2)
        if self._plate is not None and not self._correlated:
            e, t = self._plate
            k_square = (e.sd**2 + e.mean**2) * t.expect(lambda x: stiffness(1.0, x) ** 2)
            m_square = t.expect(lambda x: mass(x) ** 2)
        else:
            k_square = self._expect(lambda km: km[..., 0] ** 2)
            m_square = self._expect(lambda km: km[..., 1] ** 2)
        out: dict[str, float] = {}
        for v, b in zip(self.variables, self.marginals(), strict=True):
            for what in ("lower", "mean", "upper", "sd"):
                out[f"{v}_{what}_{UNITS[v].replace('µ', 'u').replace('/', '_per_')}"] = getattr(b, what)
        out |= {
            "D_over_G_lower": d.lower / g.upper,
            "D_over_G_upper": d.upper / g.lower,
            "K_lower_N_per_m": float(ks.min()),
            "K_mean_N_per_m": self.mean_K,
            "K_upper_N_per_m": float(ks.max()),
            "K_sd_N_per_m": float(np.sqrt(max(k_square - self.mean_K**2, 0.0))),
            "M_lower_ug": float(ms.min()),
            "M_mean_ug": self.mean_M,
            "M_upper_ug": float(ms.max()),
            "M_sd_ug": float(np.sqrt(max(m_square - self.mean_M**2, 0.0))),
            "U_pi_lower_V": float(u_pi[0]),
            "U_pi_mean_switch_V": float(pull_in_voltage(self.mean_switch, plate_area_um2)),
            "U_pi_upper_V": float(u_pi[1]),
        }
        return out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings that `from_dict` turns back into an equal population; a campaign stores this."""
        out: dict[str, Any] = {"name": self.name, "description": self.description}
        if self.plate_area_um2 is not None:
            out["plate_area_um2"] = self.plate_area_um2
        for v, marginal in zip(self.variables, self.marginals(), strict=True):
            out[v] = marginal.to_dict()
        if self.correlation:
            out["correlation"] = [list(pair) for pair in self.correlation]
        if self.formula is not None:
            out["law"] = self.formula.to_dict()
        return out

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Population:
        """Inverse of `to_dict`. Raises PopulationError where it is no such dictionary."""
        if isinstance(data, Mapping) and "law" in data:
            data = {key: v for key, v in data.items() if key != "law"} | {"formula": Formula.from_dict(data["law"])}
        try:
            return checked(cls, data, PopulationError)
        except PopulationError as e:
            raise PopulationError(f"this is not a stored population: {e}") from e


def switches_from_parameters(parameters: ArrayLike) -> FloatArray:
    """Eqs. 4 and 6. parameters: (n, 4) D, G [µm], E [GPa], T [µm]; returns (n, 4) D, G [µm], K [N/m], M [µg]."""
    p = np.asarray(parameters, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 4:
        raise PopulationError(f"parameters have shape {p.shape}; expected (n, 4): columns D, G, E, T")
    if not (p[:, 3] > A1).all():
        raise PopulationError(f"T is {np.min(p[:, 3]):g} µm for some switch; Eq. 4 needs more than {A1} µm")
    return np.stack([p[:, 0], p[:, 1], stiffness(p[:, 2], p[:, 3]), mass(p[:, 3])], axis=1)


def index_uniforms(n: int, *, seed: int, start: int, stream: int) -> FloatArray:
    """(n, 4) independent uniforms in [0, 1): row i depends on (seed, stream, start + i) and nothing else."""
    words = _key(seed, stream, "monte-carlo").generate_state(2, np.uint64)
    # One Philox block is four 64-bit words: exactly one row, so the counter is the row's index.
    return np.random.Generator(np.random.Philox(key=words, counter=int(start))).random((int(n), 4))


def _key(seed: int, stream: int, sampling: str) -> np.random.SeedSequence:
    """Spreads a seed of any size over Philox's 128-bit key; the last spawn key tells the samplings apart."""
    return np.random.SeedSequence(int(seed), spawn_key=(int(stream), SAMPLINGS.index(sampling)))


def _uniforms(n: int, *, seed: int, sampling: str, start: int, stream: int) -> FloatArray:
    """Rows `start` to `start + n` of the (seed, stream) sequence in [0, 1)⁴."""
    for what, value, least in (("n", n, 1), ("seed", seed, 0), ("start", start, 0), ("stream", stream, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise PopulationError(f"{what} is {value!r}; it must be an integer of {least} or more")
    if sampling not in SAMPLINGS:
        raise PopulationError(f"sampling is {sampling!r}; it must be one of {', '.join(SAMPLINGS)}")
    if sampling == "monte-carlo":
        return index_uniforms(n, seed=seed, start=start, stream=stream)
    if sampling == "replicated":
        return _replicated(int(n), _key(seed, stream, sampling), int(start))
    return _scrambled(int(n), _key(seed, stream, sampling), int(start))


def _replicated(n: int, key: np.random.SeedSequence, start: int) -> FloatArray:
    """Rows `start` to `start + n`: row i is point i // R of scrambling i mod R."""
    out = np.empty((n, 4))
    for r, own in enumerate(key.spawn(REPLICATES)):
        first = (r - start) % REPLICATES  # its first row among these
        rows = out[first::REPLICATES]
        if len(rows):
            rows[:] = _scrambled(len(rows), own, (start + first) // REPLICATES)
    return out


def _scrambled(n: int, key: np.random.SeedSequence, start: int) -> FloatArray:
    """Points `start` to `start + n` of one scrambled Sobol sequence in [0, 1)⁴."""
    if start + n > MOST_POINTS:
        raise PopulationError(f"start + n is {start + n}; a Sobol sequence has at most {MOST_POINTS} points")
    return scrambled_sobol(4, n, np.random.default_rng(key), start=start)
