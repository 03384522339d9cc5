"""Does a spring stay symmetric? Lowest eigenvalues of the full-domain tangent along a load path.

A design is doubly symmetric, and its load path is followed on one quarter, where nothing but
symmetric deformation is possible. Here the same states are mirrored to the full domain, where only
the boundary conditions of 2.5 restrict the displacements, and the tangent K at a prescribed d is
examined: while it is positive definite, the state is a minimum of the energy under displacement
control; where its lowest eigenvalue becomes negative, the spring leaves the symmetric path (a mode
that is antisymmetric in x or in y) or snaps (a symmetric one).

What the eigenvalue is, and which ones are computed, is told in `ngspring.analysis.modes`. An
axisymmetric spring is examined for axisymmetric modes only.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ngspring.analysis.forward import nodal_values
from ngspring.analysis.mechanics import Equilibrium, Mechanics
from ngspring.analysis.modes import MOST_NEGATIVE, FullTangent, Mode, mirrored
from ngspring.analysis.path import both_ways, checked_displacements, follow, in_order
from ngspring.analysis.states import path_displacements
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.process import parallel
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

#: Eigenvalues smaller than this in size are zero within rounding: a mechanism, no instability.
ZERO = 1e-8


@dataclass(frozen=True, eq=False)
class StabilityPoint:
    """The tangent at one displacement.

    Attributes
    ----------
    d, q : float
        Displacement in mm and reaction force in N.
    modes : tuple of Mode
        The lowest ones in increasing order: all with a negative eigenvalue (the 24 nearest zero if
        there are more) and a few more.
    negative : int or None
        Number of negative eigenvalues by the inertia of a factorisation (PARDISO's, or scipy's if
        that is not installed), a count that owes nothing to the eigenvalue solver; None if that
        failed, and the modes are then those next to zero.
    imbalance : float
        Norm of the forces on the full domain's free displacements, relative to the reaction force
        plus the one at 0.1 % strain: rounding errors, if the mirrored state is in equilibrium.
    u : array (2, nx, ny)
        The mirrored state in mm at the places of `Mode.nodes`.
    """

    d: float
    q: float
    modes: tuple[Mode, ...]
    negative: int | None
    imbalance: float
    u: FloatArray

    @property
    def lowest(self) -> float:
        """The lowest eigenvalue."""
        return self.modes[0].eigenvalue

    @property
    def verdict(self) -> str:
        """One of "stable", "neutral" (zero within rounding) and "unstable"."""
        if self.unstable_mode() is not None:
            return "unstable"
        return "neutral" if self.lowest <= ZERO else "stable"

    def unstable_mode(self, kind: str | None = None) -> Mode | None:
        """The mode with the lowest eigenvalue (of this kind) if that is negative."""
        modes = (mode for mode in self.modes if kind in (None, mode.kind))
        lowest = next(modes, None)
        return None if lowest is None or lowest.eigenvalue >= -ZERO else lowest

    def like(self, mode: Mode) -> Mode | None:
        """The lowest mode here with the kind and symmetry of another."""
        wanted = mode.kind, mode.symmetry
        return next((m for m in self.modes if (m.kind, m.symmetry) == wanted), None)


@dataclass(frozen=True, eq=False)
class Critical:
    """Where the path loses its stability on the way from rest.

    Attributes
    ----------
    point : StabilityPoint
        The state, computed at the displacement where the eigenvalue is zero by interpolation; the
        nearest unstable one if the mode is not among the lowest of the stable state before.
    mode : Mode
        The mode with this eigenvalue, as it is in `point`.
    bracket : tuple of 2 float
        The nearest displacements in mm computed before, stable and unstable; at most 0.01 H apart.
    """

    point: StabilityPoint
    mode: Mode
    bracket: tuple[float, float]

    @property
    def d(self) -> float:
        """Critical displacement in mm."""
        return self.point.d

    @property
    def q(self) -> float:
        """Critical force in N."""
        return self.point.q


@dataclass(frozen=True, eq=False)
class Stability:
    """Outcome of `stability`.

    Attributes
    ----------
    problem : SpringProblem
    eta : float
        Offset of chi.
    points : tuple of StabilityPoint
        One for each requested displacement that was reached, in the order they were asked for.
    critical : tuple of Critical
        First loss of stability in compression and in tension, if any. If its mode is one of grey
        or void, it is followed by the first one in the solid, if any.
    rest : float
        The lowest eigenvalue at d = 0.
    complete : bool
        Whether every displacement was reached.
    message : str
        Where and why the path ended, if it did.
    """

    problem: SpringProblem
    eta: float
    points: tuple[StabilityPoint, ...]
    critical: tuple[Critical, ...]
    rest: float
    complete: bool
    message: str

    @property
    def d(self) -> FloatArray:
        """Displacements in mm."""
        return np.array([point.d for point in self.points])

    @property
    def q(self) -> FloatArray:
        """Reaction forces in N."""
        return np.array([point.q for point in self.points])

    @property
    def relative(self) -> FloatArray:
        """Lowest eigenvalues relative to the one at d = 0."""
        return np.array([point.lowest for point in self.points]) / self.rest

    @property
    def stable(self) -> bool:
        """Whether no unstable state was found."""
        return not self.critical

    @property
    def spring_stable(self) -> bool:
        """Whether no unstable mode in the solid was found, whatever grey and void do."""
        return all(critical.mode.kind != "solid" for critical in self.critical)


class _Analysis:
    """A load path on the quarter whose states are examined on the full domain."""

    def __init__(self, design: Design, eta: float, modes: int, solver: str, threads: int) -> None:
        def prepared(domain: str) -> tuple[ScalarSpace, FloatArray]:
            scalar = ScalarSpace(Grid(design.problem.replace(domain=domain)))
            return scalar, spline_extraction(scalar) @ design.coefficients.ravel()

        self.part, chi = prepared("quarter")
        self.quarter = Mechanics(self.part, chi, eta, solver, threads)
        self.whole, chi = prepared("full")
        self.tangent = FullTangent(self.whole, chi, eta, solver, threads)
        self.modes = modes
        self.rest = self.quarter.at_rest()
        self._small = 1e-3 * design.problem.H * self.rest.stiffness

    def examine(self, state: Equilibrium) -> StabilityPoint:
        """Mirror a state to the full domain and compute its lowest modes."""
        d, tangent = state.d, self.tangent
        field = mirrored(self.part, self.whole, self.quarter.full_field(d, state.u), d)
        u = tangent.body.images.restrict(field)
        forces = tangent.body.forces(d, u)[:-1]
        imbalance = float(np.linalg.norm(forces)) / (abs(state.q) + self._small)
        values, vectors, negative = tangent.lowest(d, u, self.modes)
        modes = tuple(tangent.mode(float(w), v) for w, v in zip(values, vectors.T, strict=True))
        found = int((values < 0).sum())
        if negative is not None and found != min(negative, MOST_NEGATIVE):
            logger.warning(
                "d = %g mm: %d negative eigenvalues by inertia, %d found", d, negative, found
            )
        logger.info("d = %g mm: lowest eigenvalue %.4g, in %s", d, values[0], modes[0].kind)
        nodes = np.array([nodal_values(self.whole, part) for part in field.reshape(2, -1)])
        return StabilityPoint(d, state.q, modes, negative, imbalance, nodes)

    def first_loss(
        self, side: list[tuple[Equilibrium, StabilityPoint]], kind: str | None
    ) -> Critical | None:
        """First loss of stability (by a mode of this kind) along examined states from rest."""
        for (before, stable), (after, unstable) in pairwise(side):
            if unstable.unstable_mode(kind) is not None:
                return self._locate(before, stable, after, unstable, kind)
        return None

    def _locate(
        self,
        before: Equilibrium,
        stable: StabilityPoint,
        after: Equilibrium,
        unstable: StabilityPoint,
        kind: str | None,
    ) -> Critical:
        height = self.part.grid.problem.H
        while True:
            mode = unstable.unstable_mode(kind)
            assert mode is not None
            partner = stable.like(mode)
            # Only with the mode's eigenvalue on both sides can the zero be interpolated.
            widest = (0.001 if partner is None else 0.01) * height
            if abs(after.d - before.d) <= widest:
                break
            reached, _ = follow(self.quarter, np.array([(before.d + after.d) / 2]), before)
            if not reached:
                break
            point = self.examine(reached[0])
            if point.unstable_mode(kind) is None:
                before, stable = reached[0], point
            else:
                after, unstable = reached[0], point
        bracket = (before.d, after.d)
        if partner is None:
            return Critical(unstable, mode, bracket)
        share = partner.eigenvalue / (partner.eigenvalue - mode.eigenvalue)
        d = before.d + min(max(share, 0.0), 1.0) * (after.d - before.d)
        reached, _ = follow(self.quarter, np.array([d]), before)
        if not reached:
            return Critical(unstable, mode, bracket)
        point = self.examine(reached[0])
        return Critical(point, point.like(mode) or mode, bracket)


def stability(
    design: Design,
    displacements: Iterable[float] | None = None,
    *,
    eta: float = 0.0,
    modes: int = 4,
    threads: int | None = None,
    solver: str = "auto",
) -> Stability:
    """Examine whether the symmetric load path of a design is stable under displacement control.

    Parameters
    ----------
    design : Design
    displacements : iterable of float, optional
        Displacements in mm; by default nine evenly spaced ones between the outermost control
        points (and zero), the control points, and zero.
    eta : float
        Offset of chi: dilation or erosion (2.6).
    modes : int
        How many of the lowest modes to compute, on top of all negative ones.
    threads, solver
        See `ngspring.optimize`.

    Returns
    -------
    Stability

    Raises
    ------
    ProblemError
        For a displacement that is not a finite number smaller than H in size, an eta that is not
        finite, or less than one mode.
    ConvergenceError
        If eigenvalues do not converge.
    """
    problem = design.problem
    if displacements is None:
        displacements = path_displacements(design, 9)
    targets = checked_displacements(displacements, problem)
    if not np.isfinite(eta):
        raise ProblemError(f"eta = {eta!r} must be a finite number")
    if modes < 1:
        raise ProblemError(f"modes = {modes!r} must be at least 1")
    with parallel(threads, problem) as count:
        analysis = _Analysis(design, eta, modes, solver, count)
        rest = analysis.examine(analysis.rest)
        points = [rest]
        critical: list[Critical] = []
        messages = []
        for targets_of_side in reversed(both_ways(targets)):
            states, message = follow(analysis.quarter, targets_of_side, analysis.rest)
            if message:
                logger.warning(message)
                messages.append(message)
            examined = [analysis.examine(state) for state in states]
            points += examined
            side = [(analysis.rest, rest), *zip(states, examined, strict=True)]
            first = analysis.first_loss(side, None)
            if first is not None:
                critical.append(first)
                if first.mode.kind != "solid":
                    further = analysis.first_loss(side, "solid")
                    critical += [] if further is None else [further]
    return Stability(
        problem=problem,
        eta=eta,
        points=tuple(in_order(targets, points)),
        critical=tuple(critical),
        rest=rest.lowest,
        complete=not messages,
        message="; ".join(messages),
    )
