"""How long a whole run takes on this machine, and where its time goes."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ngspring.design.history import History
from ngspring.evolution.optimize import optimize
from ngspring.evolution.steprule import Rule
from ngspring.evolution.updates import Observer, Result, Update
from ngspring.fem.process import threads_for
from ngspring.kkt.bench import peak_memory
from ngspring.kkt.timings import Timings
from ngspring.problem.spring import SpringProblem

#: What the seconds of a run are told apart into, in the order of the command's table, in words.
PARTS: Mapping[str, str] = {
    "preparation": "mesh, forms, patterns and index maps",
    "path": "load paths of the start, and of the end",
    "assembly": "assembly",
    "reduction": "reduction to independent unknowns",
    "factorisation": "factorisation",
    "solve": "solves and their refinement",
    "residual": "residuals",
    "equilibrium": "equilibrium between the iterations (elimination)",
    "terms": "terms of the objective",
    "files": "checkpoints, snapshots and the design",
    "pictures": "pictures and report",
    "rest": "the rest",
}


@dataclass(frozen=True)
class RunBenchmark:
    """Outcome of `benchmark_run`.

    Attributes
    ----------
    seconds : float
        Of the whole run, start to end.
    parts : dict
        Seconds of each of `PARTS`; they add up to ``seconds``.
    updates, rejected : int
        Design updates that were accepted, and that were tried in vain.
    iterations, rejected_iterations : int
        Coupled Newton iterations of the accepted updates, and of the others.
    peak_memory : float
        Largest memory the process ever had, in GB (1e9 bytes); NaN where the system does not tell.
    threads : int
        What was used.
    converged : bool
    width : float
        W/H, or D/H, that was reached.
    message : str
        Why the run has not converged, if it has not.
    """

    seconds: float
    parts: Mapping[str, float]
    updates: int
    rejected: int
    iterations: int
    rejected_iterations: int
    peak_memory: float
    threads: int
    converged: bool
    width: float
    message: str

    @property
    def seconds_an_iteration(self) -> float:
        """Of the run with all that belongs to it but pictures; NaN if there was no iteration."""
        count = self.iterations + self.rejected_iterations
        return (self.seconds - self.parts["pictures"]) / count if count else float("nan")


def benchmark_run(
    problem: SpringProblem,
    *,
    threads: int | None = None,
    solver: str = "auto",
    max_updates: int | None = None,
    rule: Rule | None = None,
    observers: Sequence[Observer] = (),
    pictures: Callable[[Result, Path], object] | None = None,
) -> RunBenchmark:
    """Time a run of `ngspring.optimize` in a folder that is thrown away.

    Parameters
    ----------
    problem : SpringProblem
    threads, solver, max_updates, rule, observers
        See `ngspring.optimize`.
    pictures : callable, optional
        What comes after the run; it gets the result and the folder.

    Raises
    ------
    ProblemError, ConvergenceError
        See `ngspring.optimize`.
    """
    timings = Timings()
    rejected: list[Update] = []

    def keep_rejected(update: Update) -> None:
        if update.rejected:
            rejected.append(update)

    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="ngspring-bench-") as name:
        folder = Path(name)
        result = optimize(
            problem,
            out=folder,
            max_updates=max_updates,
            observers=(keep_rejected, *observers),
            threads=threads,
            solver=solver,
            rule=rule,
            timings=timings,
        )
        if pictures is not None:
            with timings.part("pictures"):
                pictures(result, folder)
        seconds = time.perf_counter() - start
    return RunBenchmark(
        seconds=seconds,
        parts=_parts(timings, seconds),
        updates=len(result.history) - 1,
        rejected=len(rejected),
        **_iterations(result.history),
        peak_memory=peak_memory(),
        threads=threads_for(problem, threads),
        converged=result.converged,
        width=result.design.relative_width,
        message=result.message,
    )


def _parts(timings: Timings, seconds: float) -> dict[str, float]:
    known = {name: timings.seconds.get(name, 0.0) for name in PARTS if name != "rest"}
    return {**known, "rest": seconds - sum(known.values())}


def _iterations(history: History) -> dict[str, int]:
    rows = history.rows()
    return {
        "iterations": sum(row.newton_iterations for row in rows),
        "rejected_iterations": sum(row.rejected_iterations for row in rows),
    }
