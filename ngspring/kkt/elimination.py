"""Equilibrium inside the coupled iteration: nonlinear elimination of the displacements.

A coupled Newton step moves chi and u together along a straight line. Where contact is about to
happen, or the void is about to buckle, equilibrium bends away from that line much faster than
anything else in the system, and the plain iteration needs tiny steps. So after each step that
leaves equilibrium badly violated, Eq. 4 alone is solved for u with the new chi (a system of a
sixth of the size), and the adjoint displacement is made the one of that state with the multiplier
lam_Ty of the coupled step. The next coupled step then starts from there; where the plain
iteration converges, nothing changes, and neither does the solution.
"""

from __future__ import annotations

import numpy as np

from ngspring.analysis.mechanics import Mechanics
from ngspring.analysis.newton import NewtonError, Step, newton
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import Timings, timed
from ngspring.problem.imperfection import Offset
from ngspring.problem.scaling import force_unit


class Elimination:
    """Brings the displacements of a state back into equilibrium with its chi.

    Parameters
    ----------
    system : CoupledSystem
    """

    #: Control points whose forces are out of balance by less than this, relative to the target
    #: force, are left as they are ...
    THRESHOLD = 1e-3
    #: ... and the others are balanced to this; the coupled iteration does the rest.
    ACCURACY = 1e-4
    MAX_ITERATIONS = 12
    MAX_SETTLING = 40

    def __init__(self, system: CoupledSystem) -> None:
        self.system = system
        self.iterations = 0
        self._mechanics: dict[str, Mechanics] = {}

    def _body(self, chi: FloatArray, offset: Offset) -> Mechanics:
        """The mechanics of a chi (dofs of the scalar space) with an offset."""
        system = self.system
        kind = offset.odd_in if offset.odd else ""
        body = self._mechanics.get(kind)
        if body is None:
            body = Mechanics(system.scalar, chi, offset, system.solver, system.threads)
            self._mechanics[kind] = body
        body.set_design(chi, offset)
        return body

    @property
    def timings(self) -> Timings:
        """Those of the system."""
        return self.system.timings

    @timed("equilibrium")
    def relax(self, old: State, new: State) -> State:
        """The state ``new`` with u in equilibrium where it was far from it.

        Raises
        ------
        ConvergenceError
            If equilibrium cannot be found.
        """
        system = self.system
        chi = system.extraction_chi @ new.chi
        u, lam = new.u.copy(), new.lam.copy()
        for j, point in enumerate(system.points):
            body = self._body(chi, point.offset)
            old_u, new_u = old.u[j, : body.free], new.u[j, : body.free]
            scale = abs(point.q_star) + 1e-4 * force_unit(system.problem)
            force = body.forces(point.d, new_u)
            # A NaN is an inverted element and fails this test.
            if np.linalg.norm(force[:-1]) <= self.THRESHOLD * scale:
                continue
            guess, force = self._admissible(body, point.d, old_u, new_u)
            accuracy = self.ACCURACY * scale
            u[j, : body.free], shape = self._balance(body, point.d, guess, force, accuracy)
            lam[j, : body.free] = shape * lam[j, -1]
            load = system.adjoint_load(chi, u[j, : body.free], j)
            if load is not None:
                lam[j, : body.free] -= body.solve_linear(load[:-1])
        return State(new.chi, u, lam)

    @staticmethod
    def _admissible(
        body: Mechanics, d: float, old: FloatArray, new: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Displacements as far on the way from old to new as no element is inverted."""
        force = body.forces(d, new)
        if np.isfinite(force).all():
            return new, force
        for part in (0.5, 0.25, 0.1, 0.0):
            guess = old + part * (new - old)
            force = body.forces(d, guess)
            if np.isfinite(force).all():
                return guess, force
        raise ConvergenceError("the last accepted displacements invert an element")

    def _balance(
        self, body: Mechanics, d: float, u: FloatArray, force: FloatArray, accuracy: float
    ) -> tuple[FloatArray, FloatArray]:
        """Newton's method with backtracking; also returns du/dd of the last tangent.

        Where it fails the branch of equilibria has ended, and the spring settles elsewhere.
        """
        columns: list[FloatArray] = []

        def direction(u: FloatArray, force: FloatArray) -> FloatArray:
            self.iterations += 1
            update, column = body.newton_update(d, u, force)
            columns[:] = [column]
            return update

        def acceptable(step: Step[FloatArray]) -> bool:
            before, after = (np.linalg.norm(f[:-1]) for f in (step.before, step.after))
            return bool(np.isfinite(step.after).all() and after <= max(10 * before, accuracy))

        try:
            balanced, _, _ = newton(
                u,
                force,
                evaluate=lambda u: body.forces(d, u),
                direction=direction,
                acceptable=acceptable,
                converged=lambda step: bool(np.linalg.norm(step.after[:-1]) <= accuracy),
                max_iterations=self.MAX_ITERATIONS,
            )
        except NewtonError:
            return body.settle(d, u, accuracy, self.MAX_SETTLING)
        return balanced, -body.solve_linear(columns[0])
