"""Parameters of a law from tests, by least squares."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import choice, finite_number
from ngspring.basics.errors import ProblemError
from ngspring.problem.fit.candidates import CANDIDATES, Candidate
from ngspring.problem.fit.data import MaterialTest, as_tests
from ngspring.problem.laws import NeoHooke
from ngspring.problem.laws.base import Law
from ngspring.problem.laws.modes import MODES
from ngspring.problem.laws.stability import LARGEST, SMALLEST, StableRange, stable_range
from ngspring.problem.material import (
    FITTED_NU,
    bulk_and_shear_modulus,
    bulk_modulus,
    nu_advice,
)

#: Errors are relative to the stress, or to this part of the largest of the test where it is less.
FLOOR = 0.02
#: How much a square counts: a planar test is what a spring in plane strain does.
WEIGHTS = {"uniaxial": 1.0, "planar": 2.0, "equibiaxial": 1.0}
#: A difference in stiffness of more than this is worth a word.
REMARKABLE = 0.02
#: An uncertainty beyond this multiple of the parameter means that the tests say nothing about it.
_UNKNOWN = 1e3


@dataclass(frozen=True, eq=False)
class Fit:
    """A law fitted to tests.

    Attributes
    ----------
    candidate : str
        What was fitted, such as ``"yeoh"`` or ``"ogden-2"``.
    law : Law
        With K from the initial shear modulus and `nu`.
    nu : float
        Poisson's ratio at small strains; nothing that the tests say.
    tests : tuple of MaterialTest
        With the points that were used.
    uncertainty : dict from str to float
        Standard deviation of each parameter but K, if the errors of the points are independent;
        infinite for one that the tests do not determine, NaN where there are no more points than
        parameters.
    """

    candidate: str
    law: Law
    nu: float
    tests: tuple[MaterialTest, ...]
    uncertainty: dict[str, float]

    def errors(self, test: MaterialTest) -> FloatArray:
        """Model less measurement at a test's points, relative to the measured stress.

        Or to 2 % of the largest one, where that is more: near rest noise is all there is.
        """
        model = MODES[test.test].nominal_stress(self.law, test.stretch)
        return np.asarray((model - test.stress) / _scale(test))

    @cached_property
    def mean_error(self) -> float:
        """Root of the mean square of all relative errors, each test counting alike."""
        squares = [float((self.errors(test) ** 2).mean()) for test in self.tests]
        return float(np.sqrt(np.mean(squares)))

    @cached_property
    def largest_error(self) -> float:
        """The largest relative error."""
        return max(float(np.abs(self.errors(test)).max()) for test in self.tests)

    @property
    def stable(self) -> StableRange:
        """Where the law is stable."""
        return stable_range(self.law)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before the law is used, in sentences."""
        found = [nu_advice(self.nu)]
        # Plane strain modulus 2 G / (1 - nu), relative to 4 G.
        softer = 1 - 1 / (2 * (1 - self.nu))
        if softer > REMARKABLE:
            found.append(
                f"K is for nu = {self.nu:g}: a wall in plane strain is {100 * softer:.2g} % softer"
                " at small strains than one of an incompressible material"
            )
        kinds = {test.test for test in self.tests}
        if "planar" not in kinds:
            found.append(
                "no planar test among them: it is what a spring in plane strain does, and counts"
                " most; how well the law does there is not known"
            )
        unknown = [name for name, value in self.uncertainty.items() if value == np.inf]
        if unknown:
            found.append(
                f"these tests do not determine {', '.join(unknown)}: a law with fewer parameters"
                " does as well"
            )
        for kind in sorted(kinds):
            stretches = np.concatenate([t.stretch for t in self.tests if t.test == kind])
            low, high = self.stable.ranges[kind]
            if max(stretches.min(), SMALLEST) < low or min(stretches.max(), LARGEST) > high:
                found.append(
                    f"the law is stable in {kind} tests only from {low:.3g} to {high:.3g}, but the"
                    f" test goes from {stretches.min():.3g} to {stretches.max():.3g}: take another"
                    " law"
                )
        return tuple(text for text in found if text)

    def to_toml(self) -> str:
        """The law as a ``[material]`` table for a problem's file, or beside it."""
        sources = ", ".join(f"{t.name or 'data'} ({t.test})" for t in self.tests)
        low = min(float(t.stretch.min()) for t in self.tests)
        high = max(float(t.stretch.max()) for t in self.tests)
        words = [
            f"{self.law.name} law fitted to {' '.join(sources.split())}, stretches {low:.3g} to"
            f" {high:.3g}.",
            f"Relative errors: {100 * self.mean_error:.2g} % (root mean square), at most"
            f" {100 * self.largest_error:.2g} %.",
            f"Stable for stretches: {self.stable}.",
            *self.remarks,
        ]
        values = [
            f"{name} = {value:.7g}{self._comment(name)}"
            for name, value in self.law.parameters.items()
        ]
        lines = [*(f"# {text}" for text in words), "[material]", f'law = "{self.law.name}"']
        return "\n".join([*lines, *values]) + "\n"

    def _comment(self, name: str) -> str:
        if name == "K":
            return f"  # MPa, for nu = {self.nu:g}"
        unit = "MPa, " if name in self.law.stresses else ""
        return f"  # {unit}+- {uncertainty_text(self.uncertainty[name])}"


def uncertainty_text(value: float) -> str:
    """An uncertainty for people."""
    if np.isnan(value):
        return "unknown: as many parameters as points"
    return "unknown: the tests do not determine it" if np.isinf(value) else f"{value:.2g}"


def fit(
    tests: MaterialTest | str | Iterable[Any],
    law: str = "yeoh",
    *,
    nu: float = FITTED_NU,
    stretches: tuple[float, float] | None = None,
) -> Fit:
    """Fit a law to tests of a material.

    The sum over all tests of the mean squares of relative errors is made smallest, a planar test
    counting twice: planar tension is what a spring in plane strain does. Stresses are those of an
    incompressible solid.

    Parameters
    ----------
    tests : MaterialTest, path, or several of them
        Uniaxial, planar, equibiaxial, alone or together; of a file see
        `ngspring.read_material_test`.
    law : str
        ``neo-hooke``, ``mooney-rivlin``, ``yeoh``, ``ogden-1``, ``ogden-2``, ``ogden-3``, ``gent``
        or ``arruda-boyce``.
    nu : float
        Poisson's ratio at small strains, which gives K; rubber itself is closer to 0.5, and up to
        0.4999 the elements take it.
    stretches : pair of float, optional
        Smallest and largest stretch whose points are used: a law that need not follow what no
        spring does fits better where it counts.

    Returns
    -------
    Fit

    Raises
    ------
    ProblemError
        If there are fewer points than parameters, or no law of this kind has such stresses.

    Examples
    --------
    >>> found = ngspring.fit("sheet.csv", "yeoh", stretches=(1, 2.5))  # doctest: +SKIP
    >>> problem = ngspring.cases["C4"].replace(material=found.law)  # doctest: +SKIP
    """
    candidate = CANDIDATES[choice("law", law, tuple(CANDIDATES))]
    nu = finite_number("nu", nu)
    bulk_and_shear_modulus(1.0, nu)  # refuses what is none
    used = as_tests(tests)
    if stretches is not None:
        low, high = (finite_number("stretches", value) for value in stretches)
        used = tuple(test.between(low, high) for test in used)
    x = _least_squares(candidate, used)
    shape = candidate.law(x)
    K = bulk_modulus(shape.initial_moduli[1], nu)
    found = dataclasses.replace(shape, K=K)  # type: ignore[type-var]
    return Fit(law, found, nu, used, _uncertainty(candidate, x, used))


def fit_all(
    tests: MaterialTest | str | Iterable[Any],
    *,
    nu: float = FITTED_NU,
    stretches: tuple[float, float] | None = None,
) -> list[Fit]:
    """Every law that the tests have points enough for, the best fit first.

    Raises
    ------
    ProblemError
        If there is none.
    """
    used = as_tests(tests)
    fits, errors = [], []
    for name in CANDIDATES:
        try:
            fits.append(fit(used, name, nu=nu, stretches=stretches))
        except ProblemError as error:
            errors.append(error)
    if not fits:
        raise errors[0]
    return sorted(fits, key=lambda each: each.mean_error)


def _scale(test: MaterialTest) -> FloatArray:
    size = np.abs(test.stress)
    return np.asarray(np.maximum(size, FLOOR * size.max()))


def _residuals(law: Law, tests: tuple[MaterialTest, ...]) -> FloatArray:
    """Weighted relative errors; large where the law has no stress."""
    parts = []
    for test in tests:
        model = MODES[test.test].nominal_stress(law, test.stretch)
        part = (model - test.stress) / _scale(test)
        parts.append(part * np.sqrt(WEIGHTS[test.test] / len(part)))
    together = np.concatenate(parts)
    return np.asarray(np.nan_to_num(together, nan=1e6, posinf=1e6, neginf=-1e6))


def _least_squares(candidate: Candidate, tests: tuple[MaterialTest, ...]) -> FloatArray:
    """The parameters, the best of several starts."""
    # A quarter of a second to import, and every problem comes by the laws.
    from scipy.optimize import least_squares

    G, top = _shear_modulus(tests), _largest_invariant(tests)
    starts = np.array(candidate.starts(G, top), float)
    points = sum(len(test.stretch) for test in tests)
    if points < starts.shape[1]:
        raise ProblemError(
            f"the tests have {points} points, but {candidate.name} has {starts.shape[1]}"
            " parameters: measure more, or take a law with fewer"
        )
    best = None
    for start in starts:
        found = least_squares(
            lambda x: _residuals(candidate.law(x), tests),
            start,
            bounds=candidate.bounds(G, top, start),
            x_scale=np.maximum(np.abs(start), 1e-2 * G),
            xtol=1e-11,
            ftol=1e-11,
            gtol=1e-11,
            max_nfev=200,
        )
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return np.asarray(best.x)


def _shear_modulus(tests: tuple[MaterialTest, ...]) -> float:
    """That of the neo-Hookean law that fits best: a line through the origin."""
    unit = np.concatenate(
        [MODES[t.test].nominal_stress(NeoHooke(1.0, 1.0), t.stretch) / _scale(t) for t in tests]
    )
    measured = np.concatenate([t.stress / _scale(t) for t in tests])
    G = float(unit @ measured / (unit @ unit))
    if not G > 0.0:
        raise ProblemError("the stresses of the tests have the wrong sign on the whole")
    return G


def _largest_invariant(tests: tuple[MaterialTest, ...]) -> float:
    """Largest I_1 - 3 of the tests."""
    return max(float(np.max(MODES[t.test].stretches(t.stretch).isochoric_I_1) - 3.0) for t in tests)


def _uncertainty(
    candidate: Candidate, x: FloatArray, tests: tuple[MaterialTest, ...]
) -> dict[str, float]:
    """Standard deviations of the law's own parameters."""
    names = [name for name in candidate.law(x).parameters if name != "K"]
    residuals = _residuals(candidate.law(x), tests)
    freedom = len(residuals) - len(x)
    if freedom <= 0:
        return dict.fromkeys(names, float("nan"))
    steps = 1e-5 * np.maximum(np.abs(x), 1e-3 * np.abs(x).max())

    def slopes(of: Any) -> FloatArray:
        return np.column_stack(
            [
                (np.asarray(of(x + step)) - np.asarray(of(x - step))) / (2 * step[k])
                for k, step in enumerate(np.diag(steps))
            ]
        )

    try:
        of_residuals = slopes(lambda y: _residuals(candidate.law(y), tests))
        of_names = slopes(lambda y: [candidate.law(y).parameters[name] for name in names])
    except ProblemError:  # at a bound, where a step leads out of what is valid
        return dict.fromkeys(names, float("inf"))
    scaled = of_residuals * steps
    if np.linalg.matrix_rank(scaled, 1e-8 * np.linalg.norm(scaled, 2)) < len(x):
        return dict.fromkeys(names, float("inf"))
    root = np.linalg.pinv(scaled) * steps[:, None]
    spread = np.sqrt(residuals @ residuals / freedom * ((of_names @ root) ** 2).sum(axis=1))
    values = candidate.law(x).parameters
    return {
        name: float(s) if s < _UNKNOWN * abs(values[name]) else float("inf")
        for name, s in zip(names, spread, strict=True)
    }
