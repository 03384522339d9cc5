"""A design update of a single coupled Newton iteration, judged by the decrease of C (2.4, 2.7).

The paper iterates each backward Euler step to convergence. Near the optimum that is accuracy for
its own sake: only the stationary point is wanted, and iterations that bounce between the creases of
a contact do not converge although most of them improve the design. Here the update is one iteration
of the same coupled system, with the present design as the old one (pseudo-transient continuation;
Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998), and the objective with the displacements in
equilibrium, C(chi), says what it was worth: it is accepted if C falls by a fair part of what the
quadratic model promised, and dt follows from how good the model was, as the radius of a trust
region does. An iteration whose matrix has the wrong inertia would climb towards a saddle of C(chi)
and is rejected.

The transient term vanishes at the stationary point, which is the same for both kinds of update.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngspring.elimination import Elimination
from ngspring.errors import ConvergenceError
from ngspring.kkt import CoupledSystem, LinearSolveError, Residual, State
from ngspring.newton import relative_residuals
from ngspring.splines import FloatArray

#: A larger change of chi in one iteration is no step of a quadratic model that anyone should trust.
LARGEST_CHANGE = 1e3
#: Relative to C: decreases that are promised below this are lost in rounding.
_ROUNDING = 1e-9
#: Out of balance by less than this, relative to the target force, stays as the iteration left it.
_BALANCE, _ACCURACY = 1e-4, 1e-7
#: A multiplier is scaled where it changes by less than this part of itself.
_OWN_SHAPE = 0.5


@dataclass(frozen=True, eq=False)
class DescentStep:
    """Outcome of one iteration.

    Attributes
    ----------
    state : State
        The new state if accepted, else the old one.
    accepted : bool
    ratio : float
        Decrease of C over the one that the quadratic model promised; 1 where that is below what
        rounding lets one see.
    optimality : float
        Norm of Eq. 8's residual without the transient term, relative to its largest term.
    reason : str
        Why it was not accepted.
    """

    state: State
    accepted: bool
    ratio: float
    optimality: float
    reason: str


@dataclass(frozen=True, eq=False)
class _Evaluated:
    state: State
    residual: Residual
    C: float


class Descent:
    """Takes single iterations from one state to the next.

    Parameters
    ----------
    system : CoupledSystem
    """

    def __init__(self, system: CoupledSystem) -> None:
        self.system = system
        self._elimination = Elimination(system, _BALANCE, _ACCURACY)
        self._given: State | None = None
        self._present: _Evaluated | None = None

    def step(self, state: State, dt: float, least: float = 0.2) -> DescentStep:
        """One coupled Newton iteration over dt from a state that is (nearly) in equilibrium.

        ``least`` is the part of the promised decrease of C that it must bring.
        """
        present = self._present
        if present is None or self._given is not state:
            present = self._evaluated(state)
        self._given, self._present = state, present
        try:
            new, promised = self._iterated(present, dt)
        except (ConvergenceError, LinearSolveError) as error:
            return DescentStep(state, False, 0.0, np.inf, str(error))
        visible = promised > _ROUNDING * abs(present.C)
        ratio = (present.C - new.C) / promised if visible else 1.0
        if not ratio >= least:
            reason = f"C falls by {ratio:.2g} of what was expected"
            return DescentStep(state, False, ratio, np.inf, reason)
        self._given, self._present = new.state, new
        optimality = float(relative_residuals(self.system, new.residual)[0])
        return DescentStep(new.state, True, ratio, optimality, "")

    def _iterated(self, present: _Evaluated, dt: float) -> tuple[_Evaluated, float]:
        """The next state, and the decrease of C that the quadratic model promises."""
        system, state, residual = self.system, present.state, present.residual
        if not residual.finite:
            raise ConvergenceError("an element is inverted")
        system.assemble(state, dt)
        negative, expected = system.negative_eigenvalues, system.eigenvalues_of_a_minimum
        if negative is not None and negative != expected:
            raise ConvergenceError(f"C is not convex there ({negative - expected:+d} eigenvalues)")
        update = system.solve(residual)
        change = float(np.abs(update.chi).max())
        # A NaN fails this test, too.
        if not change <= LARGEST_CHANGE:
            raise ConvergenceError(f"the change of chi is too large ({change:.1e})")
        full = system.extraction_chi @ update.chi
        slope = float(residual.chi @ update.chi)
        promised = (float(full @ (system.design.transient_matrix @ full)) / dt - slope) / 2
        if promised <= 0.0:
            raise ConvergenceError("the iteration leads uphill")
        new = self._evaluated(self._elimination.relax(state, state.moved(update)))
        if not new.residual.finite:
            raise ConvergenceError("an element was inverted")
        return new, promised

    def _evaluated(self, state: State) -> _Evaluated:
        """A state with multipliers that belong to its forces, its residual, and C."""
        residual = self.system.residual(state, state.chi, np.inf)
        if residual.finite:
            lam = self._multipliers(state, residual)
            if lam is not None:
                state = State(state.chi, state.u, lam)
                residual = self.system.residual(state, state.chi, np.inf)
        return _Evaluated(state, residual, self.system.terms(state)["C"])

    def _multipliers(self, state: State, residual: Residual) -> FloatArray | None:
        """The multipliers with ``lam_Ty = w_q (q - q*)``, or None where they are so already.

        The forces out of balance belong to q, weighted by du/dd; and lam is proportional to
        lam_Ty by the same vector (Eq. 7).
        """
        lam = state.lam.copy()
        for j, point in enumerate(self.system.points):
            top = state.lam[j, -1]
            missing = float(state.lam[j] @ residual.lam[j])
            if abs(point.weight * missing) < _OWN_SHAPE * top**2:
                lam[j] *= 1.0 + point.weight * missing / top**2
            else:
                # A multiplier that changes so much has lost the digits of its vector.
                lam[j] = self._multiplier(state, residual, j)
        same = np.allclose(lam, state.lam, rtol=1e-10, atol=0.0)
        return None if same else lam

    def _multiplier(self, state: State, residual: Residual, j: int) -> FloatArray:
        point = self.system.points[j]
        body = self._elimination.body(self.system.extraction_chi @ state.chi, point.eta)
        column, _ = body.assemble(point.d, state.u[j])
        shape = np.append(-body.solve_linear(column), 1.0)
        top = state.lam[j, -1] + point.weight * float(shape @ residual.lam[j])
        return np.asarray(shape * top)
