"""How long the parts of a coupled Newton iteration take on this machine."""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import dataclass

import numpy as np

from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.process import parallel
from ngspring.kkt.start import initial_state
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import Timings
from ngspring.problem.cases import cases
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

PARTS = ("assembly", "reduction", "factorisation", "solve", "residual")

# C7 first, then more of the same kind.
_POINTS = (
    *cases["C7"].control_points,
    *(ControlPoint(d, q) for d, q in ((20, 4), (5, 1), (-5, -1), (15, 3), (-15, -3.5))),
)
MOST_POINTS = len(_POINTS)


@dataclass(frozen=True)
class Benchmark:
    """Outcome of `benchmark`.

    Attributes
    ----------
    unknowns, nonzeros : int
        Of the coupled system; non-zeros of its lower triangle.
    assembly, reduction, factorisation, solve, residual : float
        Medians over the repetitions, in seconds.
    iteration : float
        Median of the whole Newton iteration in seconds.
    first_iteration : float
        The first one, with patterns, index maps and symbolic analysis.
    peak_memory : float
        Largest memory the process ever had, in GB (1e9 bytes); NaN where the system does not tell.
    threads, repeat : int
        What was used.
    """

    unknowns: int
    nonzeros: int
    assembly: float
    reduction: float
    factorisation: float
    solve: float
    residual: float
    iteration: float
    first_iteration: float
    peak_memory: float
    threads: int
    repeat: int


def bench_problem(elements: int = 80, points: int = 3, domain: str = "quarter") -> SpringProblem:
    """Case C7 on another mesh (l_i at least 0.8 elements, as in the paper), with some more points.

    Raises
    ------
    ProblemError
        If a number is out of range.
    """
    if not 1 <= points <= MOST_POINTS:
        raise ProblemError(f"control points = {points} must be 1 ... {MOST_POINTS}")
    case = cases["C7"]
    problem = case.replace(elements=elements, domain=domain, control_points=_POINTS[:points])
    return problem.replace(l_i=case.l_i * max(1.0, case.elements / elements))


def benchmark(
    problem: SpringProblem,
    *,
    threads: int | None = None,
    solver: str = "auto",
    repeat: int = 5,
) -> Benchmark:
    """Time Newton iterations of the coupled system at the column's equilibrium, at dt = 1e6.

    Parameters
    ----------
    problem : SpringProblem
    threads, solver
        See `ngspring.optimize`.
    repeat : int
        Iterations besides the first one.

    Raises
    ------
    ProblemError
        If ``repeat`` or ``threads`` is smaller than 1.
    ConvergenceError
        If the column cannot be loaded up to the control points.
    """
    for name, value in (("repeat", repeat), ("threads", threads)):
        if value is not None and value < 1:
            raise ProblemError(f"{name} = {value!r} must be 1 or more")
    dt = 1e6 * time_unit(problem)
    with parallel(threads) as count:
        system = CoupledSystem(problem, solver, count)
        state = initial_state(system, Design.column(problem))
        seconds: list[float] = []
        parts: list[Timings] = []
        for _ in range(repeat + 1):
            system.timings = Timings()
            start = time.perf_counter()
            residual = system.residual(state, state.chi, dt)
            system.assemble(state, dt)
            update = system.solve(residual)
            seconds.append(time.perf_counter() - start)
            parts.append(system.timings)
            if not np.isfinite(update.chi).all():
                raise AssertionError("the Newton update is not finite")
    medians = {name: statistics.median(t.seconds[name] for t in parts[1:]) for name in PARTS}
    return Benchmark(
        unknowns=system.unknowns,
        nonzeros=system.nonzeros,
        **medians,
        iteration=statistics.median(seconds[1:]),
        first_iteration=seconds[0],
        peak_memory=peak_memory(),
        threads=count,
        repeat=repeat,
    )


def peak_memory() -> float:
    """Largest memory this process ever had, in GB; NaN where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9
