"""How long a run will still take: an estimate from the way that dt usually goes.

dt climbs quickly to about 1e10, creeps there while material is taken away, and then climbs
steadily to 1e20. Only the last part can be predicted well; of the creeping part no more is known
than how many design updates it usually takes. In the second half of their time the estimate was
within a factor of four for all stored runs that began from a column or at random, and up to ten
times too low in the first half. Runs that continue from a finished design take fewer updates: there
it was up to twenty times too high. That a run will creep it cannot know: for CT4 and CT5, which
did so before there were leaps, it was twenty times too low.
"""

from __future__ import annotations

import numpy as np

from ngspring.design.history import History
from ngspring.evolution.steprule import StepRule
from ngspring.problem.scaling import time_unit
from ngspring.problem.spring import SpringProblem

#: Design updates of a run: median of the ten stored ones with 80 x 80 elements.
TYPICAL_UPDATES = 72
#: Above this log10(dt) all of them only climbed: by 2 an update, above `_EASY` by 5 ...
_CLIMB, _EASY = 11.2, 15.0
#: ... with this number of Newton iterations an update.
_CLIMB_ITERATIONS, _EASY_ITERATIONS = 4.0, 1.5
#: What the end takes besides: polishing, and the path from rest.
_END_ITERATIONS = 2.0
#: Fewer updates than this are not expected before the climb, however many there were.
_FEWEST = 10
_RECENT = 20


def updates_left(history: History, problem: SpringProblem) -> tuple[float, float, float]:
    """Design updates to be expected: those before the last climb of dt, and its two parts."""
    rule = StepRule()
    dt = float(history["dt"][-1])
    if np.isinf(dt):
        return 0.0, 0.0, 0.0
    end = float(np.log10(rule.end))
    level = float(np.log10(dt / time_unit(problem))) if dt > 0 else 0.0
    slow, quick = float(np.log10(rule.growth)), float(np.log10(rule.easy_growth))
    # One more at the end, without the transient term.
    easy = max(0.0, end - max(level, _EASY)) / quick + 1
    climb = max(0.0, _EASY - max(level, _CLIMB)) / slow
    if level >= _CLIMB:
        return 0.0, climb, easy
    before = TYPICAL_UPDATES - climb - easy - (len(history) - 1)
    return max(before, min(_FEWEST, (_CLIMB - level) / slow)), climb, easy


def seconds_left(history: History, problem: SpringProblem) -> float | None:
    """Seconds until dt = infinity; None as long as there are fewer than three design updates.

    Updates before the last climb are expected to take as long as the last ones did, those of the
    climb as long as their usual number of Newton iterations does in this run.

    Parameters
    ----------
    history : History
    problem : SpringProblem
    """
    if len(history) < 4:
        return None
    before, climb, easy = updates_left(history, problem)
    seconds = np.diff(history["seconds"])[-_RECENT:]
    count = (history["newton_iterations"] + history["rejected_iterations"])[1:][-_RECENT:]
    # A machine that slept, or one hard update, says nothing about the next ones.
    per_iteration = float(np.median(seconds / np.maximum(count, 1)))
    per_update = float(np.mean(np.minimum(seconds, 5 * np.median(seconds))))
    iterations = climb * _CLIMB_ITERATIONS + easy * _EASY_ITERATIONS
    if easy:
        iterations += _END_ITERATIONS
    return before * per_update + iterations * per_iteration
