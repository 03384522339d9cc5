"""From a start to the stationary point, in a run folder and with observers."""

from __future__ import annotations

from collections.abc import Sequence

from ngspring.basics.files import PathLike
from ngspring.evolution.carry_out import carried_out
from ngspring.evolution.evolve import evolve
from ngspring.evolution.ladder import Ladder
from ngspring.evolution.steprule import Rule
from ngspring.evolution.updates import Observer, Result
from ngspring.kkt.newton import NewtonSettings
from ngspring.kkt.start import Start
from ngspring.kkt.timings import Timings
from ngspring.problem.spring import SpringProblem


def optimize(
    problem: SpringProblem,
    initial: Start | None = None,
    dt_initial: float | None = None,
    max_updates: int | None = None,
    out: PathLike | None = None,
    observers: Sequence[Observer] = (),
    *,
    resume: bool = False,
    threads: int | None = None,
    solver: str = "auto",
    rule: Rule | None = None,
    newton: NewtonSettings | None = None,
    start_name: str | None = None,
    ladder: Ladder | None = None,
    timings: Timings | None = None,
) -> Result:
    """Evolve a design until it is an exact stationary point of C* (Eq. 5).

    Parameters
    ----------
    problem : SpringProblem
    initial : Design or function f(x, y), optional
        Start; `Design.column` by default. A design of another mesh is interpolated.
    dt_initial : float, optional
        First pseudo-time step; 1 (times `time_unit`) by default.
    max_updates : int, optional
        Stop after this many design updates in all.
    out : path, optional
        Run folder: a checkpoint and ``snapshots.npz`` (see `ngspring.design.snapshots`) after every
        accepted update, at the end ``design.npz`` and ``history.csv``.
    observers : sequence of callables
        Called with an `Update` after every accepted or rejected update.
    resume : bool
        Continue the run in ``out``; a finished one is returned as it is.
    threads : int, optional
        All available ones by default, or one on a mesh too small for more.
    solver : str
        See `ngspring.fem.linear.make_factorization`.
    rule : LeapRule or StepRule, optional
        How dt changes: with leaps where it does not grow (`LeapRule`, the default), or without any
        as in the paper (`StepRule`).
    newton : NewtonSettings, optional
    start_name : str, optional
        Name of the start for the design's notes.
    ladder : Ladder, optional
        The coarse meshes that come first (`ngspring.evolution.ladder`); ``NO_LADDER`` for none.
    timings : Timings, optional
        Where the seconds are added up, see `ngspring.evolution.bench`.

    Returns
    -------
    Result

    Raises
    ------
    RunFolderError
        If ``out`` holds a run already (and not ``resume``), another problem's run, is in use, or
        cannot be written.
    ConvergenceError
        If the initial design's load paths cannot be followed to the control points.
    ProblemError
        If an argument is not valid.
    """
    timings = timings or Timings()
    evolution = evolve(
        problem,
        initial,
        dt_initial,
        threads=threads,
        solver=solver,
        rule=rule,
        newton=newton,
        start_name=start_name,
        ladder=ladder,
        timings=timings,
    )
    return carried_out(evolution, problem, max_updates, out, observers, resume, timings)
