"""The coupled Newton iteration on (chi, u_j, q_j, lam_j): one design update (2.4, 2.7)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem, LinearSolveError, Residual
from ngspring.problem.scaling import force_unit, length_unit


@dataclass(frozen=True)
class NewtonSettings:
    """When a coupled Newton iteration has converged or failed.

    The defaults are for updates on the way: Newton's method converges quadratically, so what it
    leaves is far smaller than what it was stopped at, and what is left is taken up by the next
    update. The last update is iterated to `EXACT`, and then to rounding.

    Parameters
    ----------
    chi_tolerance : float
        Largest change of a spline coefficient of chi in the last iteration.
    u_tolerance : float
        Largest change of a displacement in the last iteration, relative to H.
    residual_tolerance : float
        Largest residual of each block relative to the terms it is made of.
    max_iterations : int
        More than these are a failed step.
    """

    chi_tolerance: float = 0.5
    u_tolerance: float = 1e-3
    residual_tolerance: float = 1e-2
    max_iterations: int = 10

    def at_most(self, other: NewtonSettings) -> NewtonSettings:
        """The same with tolerances no larger than those of another."""
        names = ("chi_tolerance", "u_tolerance", "residual_tolerance")
        return dataclasses.replace(
            self, **{name: min(getattr(self, name), getattr(other, name)) for name in names}
        )


#: Tolerances of the last update, without the transient term.
EXACT = NewtonSettings(chi_tolerance=1e-3, u_tolerance=1e-6, residual_tolerance=1e-6)


@dataclass(frozen=True)
class NewtonResult:
    """Outcome of one design update.

    Attributes
    ----------
    state : State
        The last iterate.
    converged : bool
    iterations : int
        Linear systems solved.
    reason : str
        Why it failed; empty if it did not.
    negative_eigenvalues : int or None
        Of the last Newton matrix, if the linear solver tells.
    optimality : float
        Norm of Eq. 8's residual relative to its largest term.
    leap : float
        Pseudo-time that was leapt over before it (`ngspring.evolution.leaps`); negative
        if such a leap was tried and given up.
    """

    state: State
    converged: bool
    iterations: int
    reason: str
    negative_eigenvalues: int | None
    optimality: float
    leap: float = 0.0


def relative_residuals(system: CoupledSystem, residual: Residual) -> FloatArray:
    """Residual norms of Eq. 8, and of Eqs. 7 and 4 of each control point, made dimensionless.

    Eq. 8 against its largest term; equilibrium against the target force; adjoint equations
    against the target force times the largest multiplier it allows for a percent of deviation.
    """
    force, length = force_unit(system.problem), length_unit(system.problem)
    # A target of no force at all must not ask for a residual of zero.
    targets = np.array([abs(point.q_star) + 1e-4 * force for point in system.points])
    chi = np.linalg.norm(residual.chi) / max(max(residual.chi_terms.values()), 1e-300)
    adjoint = np.linalg.norm(residual.u, axis=1) * length * force / targets
    equilibrium = np.linalg.norm(residual.lam, axis=1) / targets
    return np.concatenate([[chi], adjoint, equilibrium])


def solve_update(
    system: CoupledSystem,
    guess: State,
    chi_old: FloatArray,
    dt: float,
    settings: NewtonSettings,
    elimination: Elimination | None = None,
) -> NewtonResult:
    """Solve Eqs. 4, 7 and 8 with backward Euler from ``chi_old`` over ``dt``.

    ``dt = inf`` removes the transient term. Anything that is not finite (an inverted element, a
    broken factorisation) is a failed step, never an exception.
    """
    state = guess
    residual = system.residual(state, chi_old, dt)
    if not residual.finite:
        return NewtonResult(guess, False, 0, "the guess inverts an element", None, np.inf)
    height = system.problem.H
    previous = np.inf
    for iteration in range(1, settings.max_iterations + 1):
        try:
            system.assemble(state, dt)
            update = system.solve(residual)
        except LinearSolveError as error:
            return NewtonResult(state, False, iteration, str(error), None, np.inf)
        change_chi = float(np.abs(update.chi).max())
        negative = system.negative_eigenvalues
        # Told early: looking for the equilibrium of a nonsensical design would take far longer.
        if change_chi > 1e3 or (iteration > 1 and change_chi > max(previous, 2.0)):
            reason = f"the iteration diverges (change of chi {change_chi:.1e})"
            return NewtonResult(state, False, iteration, reason, negative, np.inf)
        previous = change_chi
        old = state
        state = old.moved(update)
        if elimination is not None:
            try:
                state = elimination.relax(old, state)
            except ConvergenceError as error:
                return NewtonResult(state, False, iteration, str(error), negative, np.inf)
        residual = system.residual(state, chi_old, dt)
        change_u = float(np.abs(state.u - old.u).max()) / height
        if not residual.finite:
            reason = "an element was inverted"
            return NewtonResult(state, False, iteration, reason, negative, np.inf)
        relative = relative_residuals(system, residual)
        if (
            change_chi <= settings.chi_tolerance
            and change_u <= settings.u_tolerance
            and relative.max() <= settings.residual_tolerance
        ):
            return NewtonResult(state, True, iteration, "", negative, float(relative[0]))
    reason = f"no convergence in {settings.max_iterations} iterations"
    return NewtonResult(state, False, iteration, reason, negative, float(relative[0]))
