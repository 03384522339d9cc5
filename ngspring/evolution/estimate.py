"""How long a run will still take: an estimate from the way that dt usually goes.

dt climbs quickly to about 1e10, creeps there while material is taken away, and then climbs
steadily until nothing moves any more. Only the last part can be predicted well; of the creeping
part no more is known than how many design updates it usually takes. That a run will creep for
longer it cannot know.
"""

from __future__ import annotations

import numpy as np

from ngspring.design.history import History, Row, stages
from ngspring.evolution.ladder import Ladder
from ngspring.evolution.steprule import StepRule
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

#: Design updates on the first mesh, whichever it is, and on one that takes over a design.
TYPICAL_UPDATES, TYPICAL_AFTER = 50, 30
#: Newton iterations of a design update, those of rejected ones included, before the last climb.
_ITERATIONS = 5.0
#: Seconds an iteration grow with the number of elements across to this power.
_GROWTH = 2.2
#: Above this log10(dt) all runs only climbed: by 2 an update, above `_EASY` by 5 ...
_CLIMB, _EASY = 11.2, 13.0
#: ... with this number of Newton iterations an update.
_CLIMB_ITERATIONS, _EASY_ITERATIONS = 4.0, 2.0
#: What the end takes besides: polishing, and the path from rest.
_END_ITERATIONS = 8.0
#: Fewer updates than this are not expected before the climb, however many there were.
_FEWEST = 8
_RECENT = 20


def updates_left(level: float, end: float, before: int, typical: int) -> tuple[float, float, float]:
    """Design updates to be expected: those before the last climb of dt, and its two parts.

    Parameters
    ----------
    level, end : float
        log10(dt) in `time_unit`, now and where the mesh is left.
    before : int
        Updates on this mesh so far.
    typical : int
        And how many there usually are.
    """
    rule = StepRule()
    slow, quick = float(np.log10(rule.growth)), float(np.log10(rule.easy_growth))
    easy = max(0.0, end - max(level, _EASY)) / quick + 1
    climb = max(0.0, min(end, _EASY) - max(level, _CLIMB)) / slow
    if level >= _CLIMB:
        return 0.0, climb, easy
    return max(typical - climb - easy - before, min(_FEWEST, (_CLIMB - level) / slow)), climb, easy


def seconds_left(history: History, problem: SpringProblem) -> float | None:
    """Seconds until dt = infinity; None as long as there are fewer than three design updates.

    Updates before the last climb are expected to take as long as the last ones did, those of the
    climb as long as their usual number of Newton iterations does in this run, and those on finer
    meshes (`ngspring.evolution.ladder`) longer by what an iteration costs there.

    Parameters
    ----------
    history : History
    problem : SpringProblem
        What was asked for.
    """
    rows = history.rows()
    if len(rows) < 4:
        return None
    meshes = stages(rows)
    if rows[-1].is_end:
        return 0.0
    here = rows[-1].elements or problem.elements
    ladder = Ladder()
    above = [mesh.elements for mesh in ladder.rungs(problem) if mesh.elements > here]
    per_update, per_iteration = _costs(rows, meshes[-1])
    typical = TYPICAL_AFTER if len(meshes) > 1 else TYPICAL_UPDATES
    dt = rows[-1].dt / time_unit(problem)
    end = float(np.log10(ladder.leave if above else StepRule().rest))
    left = updates_left(np.log10(dt) if dt > 0 else 0.0, end, len(meshes[-1]) - 1, typical)
    slow, climb, easy = left
    iterations = climb * _CLIMB_ITERATIONS + easy * _EASY_ITERATIONS + _END_ITERATIONS
    finer = sum((count / here) ** _GROWTH for count in above)
    iterations += finer * TYPICAL_AFTER * _ITERATIONS
    return float(slow * per_update + iterations * per_iteration)


def _costs(rows: list[Row], mesh: list[Row]) -> tuple[float, float]:
    """Seconds of a design update and of a Newton iteration on the present mesh."""
    recent = rows[-min(_RECENT, max(4, len(mesh))) :]
    seconds = np.diff([row.seconds for row in recent])
    counts = np.array([max(row.iterations, 1) for row in recent[1:]])
    sizes = [(mesh[-1].elements or 1) / (row.elements or 1) for row in recent[1:]]
    seconds = seconds * np.array(sizes) ** _GROWTH
    # A machine that slept, or one hard update, says nothing about the next ones.
    per_update = float(np.mean(np.minimum(seconds, 5 * np.median(seconds))))
    return per_update, float(np.median(seconds / counts))
