"""Where an evolution starts: a design, with its equilibria and adjoint states."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ngspring.analysis.mechanics import Equilibrium, Mechanics
from ngspring.analysis.path import follow
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.design.design import Design
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import timed
from ngspring.problem.imperfection import Offset
from ngspring.problem.spring import SpringProblem

Start = Design | Callable[[FloatArray, FloatArray], Any]


def start_design(problem: SpringProblem, initial: Start | None) -> Design:
    """The design to start from: `Design.column` by default."""
    if initial is None:
        return Design.column(problem)
    if isinstance(initial, Design):
        return initial.with_problem(problem)
    if callable(initial):
        return Design.from_function(problem, initial)
    raise ProblemError(f"initial = {initial!r} is neither a Design nor a function f(x, y)")


#: Largest step on the way to the control points, in units of H.
LARGEST_STEP = 1 / 40


def equilibria(system: CoupledSystem, chi: FloatArray) -> tuple[list[Mechanics], list[Equilibrium]]:
    """Forward solution at every control point from the undeformed state (chi: coefficients).

    The path is followed in small steps: with a large one Newton's iteration may land on another
    branch than the one the spring takes (straight walls may buckle inwards as well as outwards).

    Raises
    ------
    ConvergenceError
        If a load path ends before its control point.
    """
    full = system.extraction_chi @ chi
    mechanics: dict[Offset, Mechanics] = {}
    reached: dict[tuple[Offset, float], Equilibrium] = {}
    for offset in dict.fromkeys(point.offset for point in system.points):
        body = Mechanics(system.scalar, full, offset, system.solver, system.threads)
        mechanics[offset] = body
        for sign in (1.0, -1.0):
            targets = sorted(
                {p.d for p in system.points if p.offset == offset and p.d * sign > 0}, key=abs
            )
            if not targets:
                continue
            count = math.ceil(abs(targets[-1]) / (LARGEST_STEP * system.problem.H))
            between = np.linspace(0.0, targets[-1], count + 1)[1:]
            path, message = follow(body, np.array(sorted({*targets, *between}, key=abs)))
            if message:
                raise ConvergenceError(message)
            for equilibrium in path:
                if equilibrium.d in targets:
                    reached[offset, equilibrium.d] = body.refined(equilibrium)
    bodies = [mechanics[point.offset] for point in system.points]
    return bodies, [reached[point.offset, point.d] for point in system.points]


@timed("path")
def initial_state(system: CoupledSystem, design: Design) -> State:
    """Equilibrium (Eq. 4) and adjoint (Eq. 7) states of a design.

    Raises
    ------
    ConvergenceError
        If a load path ends before its control point.
    """
    chi = design.coefficients.ravel()
    return _with_adjoints(system, chi, *equilibria(system, chi))


@timed("path")
def state_near(system: CoupledSystem, state: State) -> State:
    """Equilibrium and adjoint states of the same chi, with displacements near those of a state.

    For targets that have changed: lam belongs to them.

    Raises
    ------
    ConvergenceError
        If there is no equilibrium near by.
    """
    full = system.extraction_chi @ state.chi
    bodies = {
        offset: Mechanics(system.scalar, full, offset, system.solver, system.threads)
        for offset in dict.fromkeys(point.offset for point in system.points)
    }
    mechanics = [bodies[point.offset] for point in system.points]
    points = [
        body.refined(body.equilibrium(control.d, u[: body.free]))
        for body, control, u in zip(mechanics, system.points, state.u, strict=True)
    ]
    return _with_adjoints(system, state.chi, mechanics, points)


def _with_adjoints(
    system: CoupledSystem, chi: FloatArray, bodies: list[Mechanics], points: list[Equilibrium]
) -> State:
    """The state of equilibria at the control points, by their bodies."""
    full = system.extraction_chi @ chi
    lam = []
    for j, (body, point, control) in enumerate(zip(bodies, points, system.points, strict=True)):
        load = system.adjoint_load(full, point.u, j)
        if load is not None:
            body.assemble(point.d, point.u)
        lam.append(body.adjoint(point, control.weight * (point.q - control.q_star), load))
    return State(np.array(chi), *system.padded([p.u for p in points], lam))
