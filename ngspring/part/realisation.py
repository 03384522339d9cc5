"""The evolution of a design whose solid has to go through the targets.

Each stationary design is remodelled, and its solid computed with real contact. As long as that
misses its targets, the third medium is asked for other forces and the design goes on from where it
is: a correction. Everything lives in the evolution's own history and checkpoint, so that a run may
be left and taken up anywhere.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngspring.basics.checks import finite_number, refused, shown
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.basics.text import significant
from ngspring.design.corrections import (
    MISSED,
    Correction,
    best_of,
    of_part,
    with_aims,
    worst_of_solid,
)
from ngspring.design.design import Design
from ngspring.design.history import History
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.evolve import Evolution
from ngspring.evolution.updates import Result, Update
from ngspring.part.aims import corrected_aims
from ngspring.part.solid_forces import solid_forces
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.response import ContactSettings

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PartSettings:
    """When a solid goes through its targets, and how long that is tried.

    Parameters
    ----------
    tolerance : float
        Largest deviation of the solid's force from a target, relative to it.
    corrections : int
        Corrections at most.
    patience : int
        Corrections in a row without a better part before it is given up.
    elements_across : int
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    contact : ContactSettings

    Raises
    ------
    ProblemError
        If a value is out of range.
    """

    tolerance: float = 0.005
    corrections: int = 12
    patience: int = 4
    elements_across: int = 4
    contact: ContactSettings = dataclasses.field(default_factory=ContactSettings)

    def __post_init__(self) -> None:
        if not 1e-6 <= finite_number("tolerance", self.tolerance) < 1.0:
            raise refused("tolerance", self.tolerance, "from 1e-6 to 1 (0.005 for half a percent)")
        for name in ("corrections", "patience", "elements_across"):
            value = getattr(self, name)
            if type(value) is not int or value < 1:
                raise ProblemError(f"{name} = {shown(value)} must be an integer of at least 1")


def verdict(
    found: tuple[Correction, ...], problem: SpringProblem, settings: PartSettings, why: str = ""
) -> str | None:
    """What the last design means for the part.

    Parameters
    ----------
    found : tuple of Correction
        All stationary designs so far.
    problem : SpringProblem
    settings : PartSettings
    why : str
        Why the last solid's path did not reach a control point, if so.

    Returns
    -------
    str or None
        Empty if its solid goes through the targets, why they are missed if that is the end, None
        if a correction is due.
    """
    last, points = found[-1], problem.control_points
    best = best_of(found, points)
    if best is None:
        missing = [points[j].d for j in of_part(points) if not np.isfinite(last.solid[j])]
        places = ", ".join(f"{d:g}" for d in missing)
        reason = f" ({why})" if why else ""
        return f"the solid's path does not reach d = {places} mm{reason}"
    if last.reached(points) and abs(last.worst(points)) <= settings.tolerance:
        return ""
    since = len(found) - 1 - best
    if len(found) <= settings.corrections and since < settings.patience:
        return None
    return _missed(found[best], problem, settings, len(found) - 1)


def is_settled(design: Design, settings: PartSettings | None = None) -> bool:
    """Whether a design is the end of its corrections: its solid meets its targets, or cannot."""
    if design.solid is None or design.info.get(MISSED):
        return bool(design.info.get(MISSED))
    far = abs(worst_of_solid(design.problem.control_points, design.solid))
    return far <= (settings or PartSettings()).tolerance


def _missed(
    best: Correction, problem: SpringProblem, settings: PartSettings, corrections: int
) -> str:
    far = best.deviations(problem.control_points)
    k = int(np.nanargmax(np.abs(far)))
    point = problem.control_points[k]
    return (
        f"after {corrections} corrections the best solid carries {significant(best.solid[k], 4)} N"
        f" at d = {point.d:g} mm instead of {point.q:g} N ({100 * far[k]:+.2g} %, more than"
        f" {100 * settings.tolerance:g} %)"
    )


class Realisation:
    """Design updates, with corrections between them; made by `ngspring.realise`.

    Iterating gives an `Update` after every design update, for what each solid carries
    (``correction``), and for the start of each correction.

    Attributes
    ----------
    evolution : Evolution
    settings : PartSettings
    """

    def __init__(
        self, evolution: Evolution, settings: PartSettings, threads: int | None = None
    ) -> None:
        self.evolution, self.settings = evolution, settings
        self._threads = threads

    def continue_from(self, checkpoint: Checkpoint) -> None:
        """Take up what a checkpoint holds; see `Evolution.continue_from`."""
        self.evolution.continue_from(checkpoint)

    def stop(self, message: str) -> None:
        """Say why the loop is left before its end."""
        self.evolution.stop(message)

    @property
    def _judged(self) -> bool:
        """Whether it is known what the solid of the present stationary design carries."""
        found = self.evolution.found
        return bool(found) and found[-1].update == self.evolution.checkpoint.history.last().update

    @property
    def over(self) -> bool:
        """Whether there is nothing more to do."""
        if not self.evolution.over:
            return False
        if self.evolution.message:
            return True
        found = self.evolution.found
        return self._judged and verdict(found, self.evolution.problem, self.settings) is not None

    def __iter__(self) -> Iterator[Update]:
        while not self.over:
            yield from self.evolution
            if self.evolution.message or not self.evolution.over:
                return
            if not self._judged:
                yield self._judge()
            if not self.over:
                update = self._correct()
                if update is None:
                    return
                yield update

    def _judge(self) -> Update:
        """Compute what the solid carries, and take it down."""
        q, why = solid_forces(
            self.evolution.design,
            elements_across=self.settings.elements_across,
            settings=self.settings.contact,
            threads=self._threads,
        )
        correction = self.evolution.carrying(q.tolist())
        found = (*self.evolution.found, correction)
        missed = verdict(found, self.evolution.problem, self.settings, why)
        update = self.evolution.note(correction, missed or "")
        logger.info("the solid carries %s N", ", ".join(f"{force:.6g}" for force in q))
        return dataclasses.replace(update, correction=correction)

    def _correct(self) -> Update | None:
        """Ask the third medium for other forces; None if that design is lost."""
        aims = corrected_aims(self.evolution.found, self.evolution.problem.control_points)
        try:
            return self.evolution.correct(aims.tolist())
        except ConvergenceError as error:
            self.evolution.stop(f"the next correction cannot begin: {error}")
            return None

    @property
    def result(self) -> Result:
        """The part that is nearest to its targets so far, or the design on the way to the first."""
        result, found = self.evolution.result, self.evolution.found
        best = best_of(found, self.evolution.problem.control_points)
        if best is None or (self.over and best == len(found) - 1 and self._judged):
            return self._told(result)
        if not self.over:
            return result
        return self._told(self._best_result(best))

    def _told(self, result: Result) -> Result:
        missed = str(result.design.info.get(MISSED, ""))
        return dataclasses.replace(result, message=result.message or missed)

    def _best_result(self, best: int) -> Result:
        """The design of an earlier correction, with the notes of the last one."""
        last, found = self.evolution.design, self.evolution.found
        chi, one = self.evolution.checkpoint.best, found[best]
        assert chi is not None
        assert last.history is not None
        problem = with_aims(self.evolution.problem, one.aims)
        history = History(last.history.columns, last.history.values[: one.update + 1])
        q = history.last().q
        info: dict[str, Any] = {k: v for k, v in last.info.items() if k not in ("failed", "grey")}
        missed = str(info.get(MISSED) or _missed(one, problem, self.settings, len(found) - 1))
        if self.evolution.message:
            missed += f"; then {self.evolution.message}"
        info |= {"q": list(q), "converged": True, MISSED: missed}
        design = Design(problem, chi.reshape(problem.coefficient_shape), history, info)
        return Result(design, history, np.array(q), True, missed)
