"""From a curve to a part whose solid goes through the targets, in a run folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from ngspring.basics.errors import ProblemError
from ngspring.basics.files import PathLike
from ngspring.design.corrections import of_part, without_aims
from ngspring.design.design import Design
from ngspring.evolution.carry_out import carried_out
from ngspring.evolution.evolve import evolve
from ngspring.evolution.ladder import Ladder
from ngspring.evolution.steprule import Rule, StepRule
from ngspring.evolution.updates import Observer, Result
from ngspring.kkt.newton import NewtonSettings
from ngspring.kkt.start import Start
from ngspring.kkt.timings import Timings
from ngspring.part.realisation import PartSettings, Realisation
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem


def realise(
    problem: SpringProblem,
    initial: Start | None = None,
    dt_initial: float | None = None,
    max_updates: int | None = None,
    out: PathLike | None = None,
    observers: Sequence[Observer] = (),
    *,
    settings: PartSettings | None = None,
    resume: bool = False,
    threads: int | None = None,
    solver: str = "auto",
    rule: Rule | None = None,
    newton: NewtonSettings | None = None,
    start_name: str | None = None,
    ladder: Ladder | None = None,
    timings: Timings | None = None,
) -> Result:
    """Design a part: its solid, with surfaces that really touch, goes through the control points.

    The design is evolved as by `ngspring.optimize`. Then its solid is computed with real contact;
    where it misses a target, the third medium is asked for another force (`ControlPoint.aim`) and
    the design goes on from there, until all targets are met (3.5, where the paper ends).

    Parameters
    ----------
    problem, initial, dt_initial, max_updates, out, observers
        See `ngspring.optimize`. A finished design or part for the same targets is taken as it is;
        without ``dt_initial`` so is one for other forces at the same displacements, which is
        followed from those to these.
    settings : PartSettings, optional
        Tolerance, and how many corrections are tried.
    resume, threads, solver, rule, newton, start_name, ladder, timings
        See `ngspring.optimize`.

    Returns
    -------
    Result
        Its design holds what was asked (``q`` of the control points), what the third medium was
        asked for (``aim``), and what the solid carries (``info["corrections"]``). The message, and
        ``info["missed"]``, say how far it came if the targets could not be met.

    Raises
    ------
    RunFolderError, ConvergenceError, ProblemError
        See `ngspring.optimize`.

    Examples
    --------
    >>> result = ngspring.realise(ngspring.cases["C4"], out="runs/C4-part")  # doctest: +SKIP
    >>> result.message or "the part does what the curve says"  # doctest: +SKIP
    """
    if not of_part(problem.control_points):
        raise ProblemError("a part needs a control point without an offset eta")
    timings = timings or Timings()
    finished = _finished(initial, problem, others=dt_initial is None)
    if dt_initial is None and finished is not None:
        # It is stationary already: the end is tried at once.
        dt_initial = 10 * StepRule().end * time_unit(problem)
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
    if finished is not None:
        evolution.aim_at([point.q_star for point in finished.problem.control_points])
    realisation = Realisation(evolution, settings or PartSettings(), threads)
    return carried_out(realisation, problem, max_updates, out, observers, resume, timings)


def _finished(initial: Start | None, problem: SpringProblem, others: bool) -> Design | None:
    """The start, if it is a finished design for the same targets, corrected or not.

    Or for ``others`` at the same displacements.
    """
    if not isinstance(initial, Design) or not initial.info.get("converged"):
        return None
    own = without_aims(initial.problem)
    if others and len(own.control_points) == len(problem.control_points):
        pairs = zip(own.control_points, problem.control_points, strict=True)
        points = [dataclasses.replace(here, q=there.q, aim=None) for here, there in pairs]
        own = own.replace(control_points=points)
    return initial if own.equals_but_for_name(without_aims(problem)) else None
