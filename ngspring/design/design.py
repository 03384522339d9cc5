"""A spring design: the coefficients of chi together with the problem they belong to."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import real_array, shown
from ngspring.basics.errors import NgspringError, ProblemError
from ngspring.basics.files import TEXT, Part, PathLike, reading_arrays, write_arrays
from ngspring.design.corrections import solid_in
from ngspring.design.history import HISTORY_PARTS, History
from ngspring.design.notes import checked_notes
from ngspring.design.splines import evaluate, greville_points
from ngspring.problem.spring import SpringProblem

VERSION = 1
_PARTS = {"problem": TEXT, "coefficients": Part("f", 2), "info": TEXT, **HISTORY_PARTS}


@dataclass(frozen=True, eq=False)
class Design:
    """A design field chi of a spring problem.

    Parameters
    ----------
    problem : SpringProblem
    coefficients : array of shape ``problem.coefficient_shape``
        Independent spline coefficients of chi, named by their Greville points
        (`ngspring.design.splines.greville_points`).
    history : History, optional
        How the design came about.
    info : mapping
        Notes that travel with the design (start, reached forces, versions); JSON types only.

    Raises
    ------
    ProblemError
        If the coefficients have another shape or are not finite real numbers, or a note is not
        what it has to be, see `ngspring.design.notes`.
    """

    problem: SpringProblem
    coefficients: FloatArray
    history: History | None = None
    info: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = real_array("the coefficients of chi", self.coefficients)
        shape = self.problem.coefficient_shape
        if values.shape != shape:
            raise ProblemError(
                f"the coefficients have shape {values.shape}, but a design on"
                f" {self.problem.elements} x {self.problem.elements} elements has {shape}"
            )
        values.setflags(write=False)
        object.__setattr__(self, "coefficients", values)
        object.__setattr__(self, "info", checked_notes(self.info, len(self.problem.control_points)))

    @classmethod
    def from_function(
        cls, problem: SpringProblem, f: Callable[[FloatArray, FloatArray], Any]
    ) -> Design:
        """Coefficients ``f(x, y)`` at the Greville points.

        Parameters
        ----------
        problem : SpringProblem
        f : callable
            Vectorised; x and y in mm from the lower left corner of the full domain, also in the
            axisymmetric case, where ``r = |x - L/2|``. The ghost layer lies half an element
            outside, at ``x = -h/2``.
        """
        x, y = greville_points(problem)
        values = real_array("chi", f(x, y))
        return cls(problem, np.broadcast_to(values, problem.coefficient_shape))

    @classmethod
    def column(cls, problem: SpringProblem) -> Design:
        """The default start, our choice for Fig. 2: a column with a thinner, softer middle.

        ``chi = 3 cos(2 pi X/L) (1 - cos(2 pi Y/H) / 2)`` with X, Y from the centre. A start
        that does not vary in y would stay constant in y for ever.
        """

        def chi(x: FloatArray, y: FloatArray) -> FloatArray:
            across = np.cos(2 * np.pi * (x / problem.L - 0.5))
            along = np.cos(2 * np.pi * (y / problem.H - 0.5))
            return 3 * across * (1 - along / 2)

        return cls.from_function(problem, chi)

    @classmethod
    def random(cls, problem: SpringProblem, seed: int = 0) -> Design:
        """Random start of Appendix B, doubly symmetric.

        Uniform values per element of a 4 x 4, an 8 x 8 and a 12 x 12 mesh within 0.4, 0.222 and
        0.154, as coefficients of quadratic splines on these meshes, added up.
        """
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise ProblemError(f"seed = {shown(seed)} must be an integer of at least 0")
        generator = np.random.default_rng(seed)
        x, y = greville_points(problem)
        x = np.maximum(x, 0.0)
        total = np.zeros(problem.coefficient_shape)
        for elements, size in ((4, 0.4), (8, 0.222), (12, 0.154)):
            values = generator.uniform(-size, size, (elements // 2, elements // 2))
            coefficients = np.vstack([values[:1], values])
            total += evaluate(problem.replace(elements=elements), coefficients, x, y)
        return cls(problem, total)

    def chi(self, x: Any, y: Any, derivative: tuple[int, int] = (0, 0)) -> FloatArray:
        """chi (or a derivative of it) at points of the full domain, vectorised.

        Parameters
        ----------
        x, y : float or arrays
            mm from the lower left corner; broadcast against each other.
        derivative : pair of int
            Order in x and in y, each 0, 1 or 2.

        Raises
        ------
        NgspringError
            For a point outside the domain, or an order that is not 0, 1 or 2.
        """
        if len(derivative) != 2 or any(order not in (0, 1, 2) for order in derivative):
            raise NgspringError(f"derivative = {derivative!r}: each order must be 0, 1 or 2")
        try:
            return evaluate(self.problem, self.coefficients, x, y, derivative)
        except ValueError as error:
            raise NgspringError(str(error)) from None

    def density(self, x: Any, y: Any) -> FloatArray:
        """rho(chi) of Eq. 2 at points of the full domain."""
        # However deep in the void, where exp(-chi) would overflow.
        return np.asarray(np.exp(-np.logaddexp(0.0, -self.chi(x, y))))

    @property
    def volume(self) -> float:
        """Volume V of the solid in mm^3 (Eq. 10, or Eq. 23), by nine Gauss points per element."""
        problem = self.problem
        nodes, weights = np.polynomial.legendre.leggauss(3)
        half = problem.elements // 2
        place = (np.arange(half)[:, None] + (nodes + 1) / 2).ravel()
        weight = np.tile(weights / 2, half)
        x, y = place * problem.h_x, place * problem.h_y
        rho = self.density(x[:, None], y[None, :])
        across = weight * problem.h_x * problem.replace(domain="quarter").measure(x)
        return float(across @ rho @ (weight * problem.h_y))

    @property
    def solid(self) -> tuple[float, ...] | None:
        """Forces in N of its solid at the control points, by real contact.

        NaN where its path did not get there; None unless `ngspring.realise` has computed them.
        """
        aims = [point.q_star for point in self.problem.control_points]
        return solid_in(self.info, aims) if self.info.get("converged") else None

    @property
    def equivalent_width(self) -> float:
        """Width of the straight column (Eq. 20) or diameter of the cylinder (Eq. 25), in mm."""
        return self.problem.equivalent_width(self.volume)

    @property
    def relative_width(self) -> float:
        """`equivalent_width` over the height: W/H or D/H, as everything that is printed."""
        return self.equivalent_width / self.problem.H

    def with_problem(self, problem: SpringProblem) -> Design:
        """The same field as a start for another problem, mesh or size (no history)."""
        source = self.problem

        def scaled(x: FloatArray, y: FloatArray) -> FloatArray:
            inside = np.maximum(x, 0.0) * (source.L / problem.L)
            return evaluate(source, self.coefficients, inside, y * (source.H / problem.H))

        if source.coefficient_shape == problem.coefficient_shape:
            return Design(problem, self.coefficients)
        return Design.from_function(problem, scaled)

    def save(self, path: PathLike) -> None:
        """Write one small self-describing .npz, atomically.

        Raises
        ------
        RunFolderError
            If it cannot be written.
        """
        arrays: dict[str, Any] = {
            "format": "ngspring-design",
            "version": VERSION,
            "problem": self.problem.to_toml(),
            "coefficients": self.coefficients,
            "info": json.dumps(dict(self.info)),
        }
        if self.history is not None:
            arrays |= self.history.parts
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: PathLike) -> Design:
        """Read a design file.

        Raises
        ------
        DesignFileError
            If the file is missing, truncated, of another version, or not a design.
        """
        with reading_arrays(path, "design", VERSION, _PARTS) as parts:
            problem = SpringProblem.parse_toml(parts["problem"])
            history = History.of_parts(parts, len(problem.control_points))
            return cls(problem, parts["coefficients"], history, json.loads(parts["info"]))
