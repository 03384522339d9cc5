"""Whether a design's states lie on the path that the spring takes when it is loaded from rest.

The evolution carries displacements along from one design update to the next. Where the design
moves past a bifurcation they stay on their branch, while the spring, loaded from rest, takes
another: walls that are kept buckled outwards may buckle inwards. Such a state satisfies Eqs. 4, 7
and 8 and meets its targets, but it is not what the spring does. Forces alone do not tell: two
branches may carry the same at a control point, and have different sensitivities.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.special import expit

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.kkt.newton import NewtonResult
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.stationarity import relative_optimality
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.spring import SpringProblem

#: Forces that differ by more than this, relative to the largest target, belong to two branches.
SAME_BRANCH = 1e-3
#: A stationary point whose density differs by more than this, in the mean over the domain, is that
#: of another design.
ANOTHER_DESIGN = 0.1
#: Residual of Eq. 8 relative to its terms, up to which the path from rest is stationary too.
STATIONARY = 1e-6


def on_same_branch(system: CoupledSystem, before: State, outcome: NewtonResult) -> NewtonResult:
    """A stationary point found without an evolution, as a failure unless it is the minimum moved.

    Parameters
    ----------
    system : CoupledSystem
    before : State
        Where it was looked for from.
    outcome : NewtonResult
    """
    if not outcome.converged:
        return outcome
    negative = outcome.negative_eigenvalues
    if negative is not None and negative != system.eigenvalues_of_a_minimum:
        return dataclasses.replace(outcome, converged=False, reason="C is no minimum there")
    now, then = expit(outcome.state.chi), expit(before.chi)
    if float(np.abs(now - then).mean()) > ANOTHER_DESIGN:
        return dataclasses.replace(outcome, converged=False, reason="that is another design")
    return outcome


def on_another_branch(problem: SpringProblem, q: FloatArray, q_rest: FloatArray) -> bool:
    """Whether forces in N at the control points are not those of the path from rest."""
    scale = max(abs(point.q_star) for point in problem.control_points)
    return bool(np.abs(q - q_rest).max() > SAME_BRANCH * (scale or np.abs(q).max()))


def path_from_rest(system: CoupledSystem, state: State) -> State | None:
    """The same design's state on the path from rest; None if ``state`` lies on it.

    Raises
    ------
    ConvergenceError
        If the path from rest ends before a control point.
    """
    problem = system.problem
    design = Design(problem, state.chi.reshape(problem.coefficient_shape))
    rest = initial_state(system, design)
    if on_another_branch(problem, state.forces(problem), rest.forces(problem)):
        return rest
    here, there = (relative_optimality(system, place) for place in (state, rest))
    return rest if there > STATIONARY and there > 10 * here else None
