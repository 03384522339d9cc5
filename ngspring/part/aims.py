"""Which forces to ask of the third medium, so that the solid carries the targets.

The solid's forces are a function of the aims that only an evolution and a contact analysis can
evaluate. Its root is looked for by Broyden's method ("good" update, C. G. Broyden, Math. Comp. 19,
1965) in aims and forces relative to the targets. The first slope says that the solid stays stiffer
by the same factor at each control point, whatever is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.design.corrections import Correction, of_part, target_sizes
from ngspring.problem.point import ControlPoint

#: Largest change of an aim in one correction, relative to the target: a design must find its way.
LARGEST_CHANGE = 0.3
#: An aim is never smaller than this share of its target, on its side.
SMALLEST_AIM = 0.1
#: A slope dq_solid/dq_aim outside of these is noise.
_SLOPES = (0.5, 2.0)


def corrected_aims(found: Sequence[Correction], points: Sequence[ControlPoint]) -> FloatArray:
    """Aims in N for the next design, one for each control point.

    Parameters
    ----------
    found : sequence of Correction
        All designs so far, in order; at least one solid reached every control point.
    points : sequence of ControlPoint
        What the solid has to go through. Those with an offset eta are not the part's: their aims
        follow that of the design itself at the same displacement.
    """
    known = [one for one in found if one.reached(points)]
    if known[-1] is not found[-1]:
        # It went too far: half the way back to the last one that can be computed.
        return np.asarray((np.array(found[-1].aims) + np.array(known[-1].aims)) / 2)
    own = of_part(points)
    targets = np.array([point.q for point in points])
    corrected = targets.copy()
    corrected[own] = _corrected(
        np.array([one.aims for one in known])[:, own],
        np.array([one.solid for one in known])[:, own],
        targets[own],
    )
    for j, point in enumerate(points):
        if not point.own:
            corrected[j] = point.q * _factor(point, points, corrected)
    return np.asarray(corrected)


def _factor(point: ControlPoint, points: Sequence[ControlPoint], corrected: FloatArray) -> float:
    """How the design itself is corrected at the displacement of a point with an offset eta."""
    same = [
        float(aim) / own.q
        for own, aim in zip(points, corrected, strict=True)
        if own.own and own.d == point.d and own.q
    ]
    return same[0] if same else 1.0


def _corrected(all_aims: FloatArray, forces: FloatArray, targets: FloatArray) -> FloatArray:
    """Aims for the next design from aims and forces (designs, control points) so far."""
    sizes = target_sizes(targets)
    aims = list(all_aims / sizes)
    misses = list((forces - targets) / sizes)
    inverse = np.diag(1 / _first_slopes(aims[0], misses[0] + targets / sizes))
    for k in range(1, len(aims)):
        inverse = _updated(inverse, aims[k] - aims[k - 1], misses[k] - misses[k - 1])
    change = np.clip(-inverse @ misses[-1], -LARGEST_CHANGE, LARGEST_CHANGE)
    wanted = aims[-1] + change
    signs = np.sign(targets)
    bounded = np.where(signs == 0.0, wanted, signs * np.maximum(signs * wanted, SMALLEST_AIM))
    return np.asarray(bounded * sizes)


def _first_slopes(aims: FloatArray, forces: FloatArray) -> FloatArray:
    """The solid's forces over the aims; 1 where that says nothing."""
    safe = np.where(aims == 0.0, 1.0, aims)
    slopes = np.where(aims == 0.0, 1.0, forces / safe)
    return np.asarray(np.clip(slopes, *_SLOPES))


def _updated(inverse: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """Broyden's inverse with what the last step has shown; as it was if that is degenerate."""
    along = inverse @ change
    size = float(step @ along)
    if abs(size) <= 0.1 * float(step @ step):
        return inverse
    return np.asarray(inverse + np.outer(step - along, step @ inverse) / size)
