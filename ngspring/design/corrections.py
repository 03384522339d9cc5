"""Corrected targets: what the third medium was asked for, and what its solid carries.

A solid with surfaces that touch is stiffer than the grey surface of the third medium (3.5). So that
the part goes through its targets, the third medium is asked for other forces
(`ngspring.realise`); every design on the way is noted here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngspring.basics.arrays import LARGEST, FloatArray
from ngspring.basics.checks import refused
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

#: The note of a design that holds them, and the one that says why its part misses.
CORRECTIONS, MISSED = "corrections", "missed"


@dataclass(frozen=True)
class Correction:
    """A stationary design on the way to a part, in numbers.

    Attributes
    ----------
    update : int
        Its design update.
    aims : tuple of float
        Forces in N that the third medium was asked for, one for each control point.
    solid : tuple of float
        Forces in N that the solid carries there by real contact; NaN where it did not get there,
        and at control points with an offset eta, which are not the part's.
    """

    update: int
    aims: tuple[float, ...]
    solid: tuple[float, ...]

    def reached(self, points: Sequence[ControlPoint]) -> bool:
        """Whether the solid reached every control point of the part."""
        return bool(np.isfinite(np.array(self.solid)[of_part(points)]).all())

    def deviations(self, points: Sequence[ControlPoint]) -> FloatArray:
        """How far the solid is from each target, as `solid_deviations`."""
        return solid_deviations(points, self.solid)

    def worst(self, points: Sequence[ControlPoint]) -> float:
        """The deviation that is largest in size; NaN if a control point was not reached."""
        return worst_of_solid(points, self.solid)

    def to_note(self) -> dict[str, Any]:
        """In JSON types; None where the solid did not get."""
        solid = [force if np.isfinite(force) else None for force in self.solid]
        return {"update": self.update, "aims": list(self.aims), "solid": solid}


def of_part(points: Iterable[ControlPoint]) -> list[int]:
    """The control points that the part has to go through: those without an offset eta."""
    return [j for j, point in enumerate(points) if point.own]


def solid_deviations(points: Iterable[ControlPoint], forces: Sequence[float]) -> FloatArray:
    """Deviation of a solid's forces from the targets q, relative to their sizes.

    Where a target is zero, relative to the largest one. Positive is stiffer or stronger.
    """
    targets = np.array([point.q for point in points])
    sizes = target_sizes(targets)
    signs = np.where(targets == 0.0, 1.0, np.sign(targets))
    return np.asarray((np.asarray(forces, dtype=float) - targets) * signs / sizes)


def worst_of_solid(points: Sequence[ControlPoint], forces: Sequence[float]) -> float:
    """The one of the part that is largest in size; NaN if a control point was not reached."""
    far = solid_deviations(points, forces)[of_part(points)]
    return float(far[np.argmax(np.abs(far))])


def target_sizes(targets: FloatArray) -> FloatArray:
    """Sizes of targets; of one that is zero that of the largest, or 1 if all are."""
    sizes = np.abs(targets)
    return np.asarray(np.where(sizes == 0.0, sizes.max(initial=0.0) or 1.0, sizes))


def with_aims(problem: SpringProblem, aims: Sequence[float]) -> SpringProblem:
    """The problem with these forces in N asked of the third medium; its targets stay."""
    points = tuple(
        dataclasses.replace(point, aim=None if aim == point.q else float(aim))
        for point, aim in zip(problem.control_points, aims, strict=True)
    )
    return problem.replace(control_points=points)


def without_aims(problem: SpringProblem) -> SpringProblem:
    """The problem as it was asked for: nothing is corrected."""
    return with_aims(problem, [point.q for point in problem.control_points])


def corrections_of(notes: Mapping[str, Any]) -> tuple[Correction, ...]:
    """What the notes of a design hold, in order; checked already."""
    return tuple(
        Correction(
            int(note["update"]),
            tuple(map(float, note["aims"])),
            tuple(np.nan if force is None else float(force) for force in note["solid"]),
        )
        for note in notes.get(CORRECTIONS, ())
    )


def solid_in(notes: Mapping[str, Any], aims: Sequence[float]) -> tuple[float, ...] | None:
    """Forces of the solid of the design that was asked for these; None if they are not known."""
    known = [one.solid for one in corrections_of(notes) if list(one.aims) == list(aims)]
    return known[-1] if known else None


def best_of(found: Sequence[Correction], points: Sequence[ControlPoint]) -> int | None:
    """Which one is nearest to the targets; None if no solid reached all of them."""
    far = [abs(one.worst(points)) if one.reached(points) else np.inf for one in found]
    return int(np.argmin(far)) if np.isfinite(far).any() else None


def checked_corrections(given: object, points: int) -> list[dict[str, Any]]:
    """The note as it has to be.

    Raises
    ------
    ProblemError
        If it is something else.
    """
    if not isinstance(given, list | tuple) or not all(_is_correction(one, points) for one in given):
        right = f"a list of corrections: update, aims and solid, {points} forces each"
        raise refused(f"the note {CORRECTIONS}", given, right)
    return [dict(one) for one in given]


def _is_correction(note: object, points: int) -> bool:
    if not isinstance(note, Mapping) or set(note) != {"update", "aims", "solid"}:
        return False
    update = note["update"]
    if isinstance(update, bool) or not isinstance(update, int) or not 0 <= update < LARGEST:
        return False
    aims, solid = note["aims"], note["solid"]
    if not all(
        isinstance(forces, list | tuple) and len(forces) == points for forces in (aims, solid)
    ):
        return False
    return all(map(_is_force, aims)) and all(force is None or _is_force(force) for force in solid)


def _is_force(value: object) -> bool:
    # A NaN fails the comparison.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
