"""What manufacturing errors do to the curve: surfaces moved in and out (3.5, named as open).

The surface moves with the level of chi. With the slope 8 / l_i, which the formulation allows at an
interface (Eq. 11), the contour chi = -8 o / l_i lies o mm further out. Actual slopes are smaller
and vary along the contour, so the level is chosen such that the surface moves by o on average: the
area gained is o times the length of the surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ngspring.analysis.states import curve_displacements, force_at
from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.basics.files import finite_or_none
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import length_unit
from ngspring.solid.contact.response import (
    ContactResponse,
    ContactSettings,
    contact_load_displacement,
)
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.outline.contour import solid_area
from ngspring.solid.outline.levelset import level_set
from ngspring.solid.outline.outline import Outline, outline
from ngspring.solid.sides import SURFACE

#: Offsets by default, in units of a hundredth of sqrt(L H).
OFFSETS = (0.1, 0.25, 0.5)
#: Relative accuracy of the mean offset.
_ACCURACY = 1e-3
#: How often the first guess of a level is taken so much further, at most.
_WIDENINGS, _FURTHER = 12, 1.5


@dataclass(frozen=True, eq=False)
class OffsetCurve:
    """The curve of a solid with its surface moved.

    Attributes
    ----------
    offset : float
        In mm, positive outwards: more material.
    level : float
        The solid is {chi > level}; NaN if there is no such solid.
    contact : ContactResponse or None
        None if there is no such solid.
    message : str
        Why not, or where its path ended.
    """

    offset: float
    level: float
    contact: ContactResponse | None
    message: str

    def q(self, d: float) -> float:
        """Force in N at a displacement; NaN where it was not reached."""
        return float("nan") if self.contact is None else force_at(self.contact, d)


@dataclass(frozen=True, eq=False)
class Tolerance:
    """Outcome of `tolerance`.

    Attributes
    ----------
    design : Design
    displacements : array
        In mm, in increasing order.
    curves : tuple of OffsetCurve
        In increasing order of the offset, zero among them.
    """

    design: Design
    displacements: FloatArray
    curves: tuple[OffsetCurve, ...]

    @property
    def points(self) -> tuple[ControlPoint, ...]:
        """Control points of the blueprint design."""
        return tuple(point for point in self.design.problem.control_points if point.own)

    @property
    def nominal(self) -> OffsetCurve:
        """The curve without an offset."""
        return next(curve for curve in self.curves if curve.offset == 0.0)

    def sensitivity(self, d: float) -> float:
        """dq/d(offset) in N/mm at a displacement, by the smallest offsets to either side."""
        size = min(abs(curve.offset) for curve in self.curves if curve.offset)
        inner, outer = (
            next(curve for curve in self.curves if curve.offset == sign * size)
            for sign in (-1.0, 1.0)
        )
        return (outer.q(d) - inner.q(d)) / (2 * size)

    def band(self, size: float) -> tuple[FloatArray, FloatArray]:
        """Least and largest force in N at every displacement for offsets up to this size.

        NaN where a curve within it does not reach.
        """
        inside = [curve for curve in self.curves if abs(curve.offset) <= size * (1 + 1e-12)]
        q = np.array([[curve.q(float(d)) for d in self.displacements] for curve in inside])
        return q.min(axis=0), q.max(axis=0)

    @property
    def sizes(self) -> tuple[float, ...]:
        """Sizes of the offsets in mm, increasing."""
        return tuple(sorted({abs(curve.offset) for curve in self.curves if curve.offset}))

    def to_dict(self) -> dict[str, Any]:
        """Everything in JSON types; what was not reached is None."""
        return {
            "name": self.design.problem.name,
            "curves": [
                {
                    "offset": curve.offset,
                    "level": finite_or_none(curve.level),
                    "d": [] if curve.contact is None else [float(d) for d in curve.contact.d],
                    "q": [] if curve.contact is None else [float(q) for q in curve.contact.q],
                    "message": curve.message,
                }
                for curve in self.curves
            ],
            "control_points": [
                {
                    "d": point.d,
                    "q_target": point.q,
                    "q": [finite_or_none(curve.q(point.d)) for curve in self.curves],
                    "sensitivity": finite_or_none(self.sensitivity(point.d)),
                }
                for point in self.points
            ],
        }


def tolerance(
    design: Design,
    offsets: Sequence[float] | None = None,
    *,
    points: int = 11,
    elements_across: int = 4,
    settings: ContactSettings | None = None,
    threads: int | None = None,
) -> Tolerance:
    """Curves of a design whose surfaces are moved in and out, each with real contact.

    Parameters
    ----------
    design : Design
    offsets : sequence of float, optional
        Sizes in mm; each is taken outwards and inwards. By default 0.1, 0.25 and 0.5 % of
        sqrt(L H), to two digits.
    points : int
        Displacements between the outermost control points (which are added, and zero).
    elements_across
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    settings, threads
        See `ngspring.solid.contact.response.contact_load_displacement`.

    Raises
    ------
    ProblemError
        If there is no offset, or one is not a positive length.
    OutlineError
        If the design itself has no clear outline. A solid that falls apart when its surface is
        moved is reported in its curve instead.
    """
    if offsets is None:
        unit = length_unit(design.problem)
        offsets = [float(f"{share * unit:.2g}") for share in OFFSETS]
    if not len(offsets):
        raise ProblemError("no offsets were given")
    for offset in offsets:
        if not (np.isfinite(offset) and 0 < offset < design.problem.L / 2):
            raise ProblemError(
                f"offset {shown(offset)} must be a positive length in mm, less than L / 2"
            )
    controls = [point.d for point in design.problem.control_points if point.own]
    wanted = sorted({0.0, *controls, *map(float, curve_displacements(design, points=points))})
    sizes = sorted(set(map(float, offsets)))
    nominal = outline(design)
    curves = []
    for offset in [-size for size in reversed(sizes)] + [0.0, *sizes]:
        try:
            level = offset_level(design, offset, nominal)
            body = mesh_body(design, level=level, elements_across=elements_across)
        except OutlineError as error:
            if offset == 0.0:
                raise
            curves.append(OffsetCurve(offset, float("nan"), None, str(error)))
            continue
        contact = contact_load_displacement(
            body, wanted, settings=settings, threads=threads, onset=math.inf
        )
        curves.append(OffsetCurve(offset, level, contact, contact.message))
    return Tolerance(design, np.array(wanted), tuple(curves))


def offset_level(design: Design, offset: float, nominal: Outline | None = None) -> float:
    """The level of chi whose contour lies ``offset`` mm further out than chi = 0 on average.

    Parameters
    ----------
    design : Design
    offset : float
        In mm, positive outwards.
    nominal : Outline, optional
        Of the design itself, if it is there already.

    Raises
    ------
    OutlineError
        If the design has no clear outline, or no level of its chi moves the surface so far.
    """
    if offset == 0.0:
        return 0.0
    nominal = outline(design) if nominal is None else nominal
    length, distance = _surface(nominal)
    area = solid_area(nominal.level_set)

    def beyond(level: float) -> float:
        moved = (solid_area(level_set(design, level=level)) - area) / length
        return moved / offset - 1

    far = -offset / distance
    for _ in range(_WIDENINGS):
        if beyond(far) >= 0:
            break
        far *= _FURTHER
    else:
        raise OutlineError(f"no level of chi moves the surface by {offset:g} mm")
    level = float(brentq(beyond, 0.0, far, xtol=1e-6 * _ACCURACY * abs(far)))
    if abs(beyond(level)) > _ACCURACY:
        raise OutlineError(f"the level of chi that moves the surface by {offset:g} mm is not clear")
    return level


def _surface(solid: Outline) -> tuple[float, float]:
    """Length in mm, and by how many mm it moves on average where the level falls by one."""
    ls = solid.level_set
    lengths, distances = [], []
    for piece in (piece for loop in solid.loops for piece in loop.pieces if piece.name == SURFACE):
        chord = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
        middle = (piece.points[1:] + piece.points[:-1]) / 2
        lengths.append(chord.sum())
        distances.append((chord / np.hypot(*ls.gradient(*middle.T))).sum())
    return float(sum(lengths)), float(sum(distances) / sum(lengths))
