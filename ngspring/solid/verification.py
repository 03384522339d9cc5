"""How far the third medium's answer is from a solid whose surfaces really touch (3.5).

A stored design is remodelled with a body-fitted mesh of {chi > level} and real contact, and both
load-displacement curves are computed at the same displacements.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngspring.analysis.finished import curve_of
from ngspring.analysis.states import (
    States,
    common_path,
    endings,
    force_at,
    path_displacements,
)
from ngspring.basics.arrays import FloatArray
from ngspring.basics.files import finite_or_none
from ngspring.basics.text import significant
from ngspring.design.design import Design
from ngspring.problem.laws.stability import instability
from ngspring.problem.point import ControlPoint, deviation, relative_deviation
from ngspring.solid.contact.response import (
    ContactResponse,
    ContactSettings,
    contact_load_displacement,
)
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.mesh_body import mesh_body

logger = logging.getLogger(__name__)

#: A deviation of more than this (of the third medium's force) is worth a sentence.
REMARKABLE = 0.05
#: A wall or a gap that is thinner than asked for by more than this share is remarked upon.
THINNER = 0.02


@dataclass(frozen=True, eq=False)
class PointVerdict:
    """Both answers at a control point.

    Attributes
    ----------
    point : ControlPoint
    q_third_medium, q_contact : float
        Forces in N; NaN where a path did not get there.
    """

    point: ControlPoint
    q_third_medium: float
    q_contact: float

    @property
    def deviation(self) -> float:
        """In N; positive where the solid is stiffer or stronger, in compression, too."""
        return float(deviation(self.q_contact, self.q_third_medium))

    @property
    def relative(self) -> float:
        """Deviation relative to the third medium's force."""
        return float(relative_deviation(self.q_contact, self.q_third_medium))


@dataclass(frozen=True, eq=False)
class Verification:
    """Outcome of `verify`.

    Attributes
    ----------
    design : Design
    body : Body
        The remodelled solid.
    third_medium : Response or StoredResponse
    contact : ContactResponse
    smallest_wall : float
        Diameter in mm of the smallest disc in the solid that touches two opposite surfaces;
        infinite if the solid has none.
    smallest_gap : float
        The same for the undeformed void between two surfaces; infinite if there is none.
    """

    design: Design
    body: Body
    third_medium: States
    contact: ContactResponse
    smallest_wall: float
    smallest_gap: float = float("inf")

    @property
    def points(self) -> tuple[PointVerdict, ...]:
        """Both answers at each control point of the blueprint design."""
        return tuple(
            PointVerdict(
                point, force_at(self.third_medium, point.d), force_at(self.contact, point.d)
            )
            for point in self.design.problem.control_points
            if point.own
        )

    @property
    def path(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """d, q by the third medium and q by real contact where both were reached."""
        return common_path(self.third_medium, self.contact)

    @property
    def largest_deviation(self) -> tuple[float, float, float]:
        """The largest deviation in force over the path.

        Returns
        -------
        d, deviation, relative : float
            Displacement in mm, deviation in N, and the deviation relative to the third medium's
            force there, as in `PointVerdict`: positive where the solid is stiffer or stronger.
        """
        return largest_deviation(*self.path)

    @property
    def largest_stretch(self) -> tuple[float, float, float]:
        """Largest principal stretch over the path, and its place x, y in the undeformed solid."""
        if not len(self.contact.d):
            return float("nan"), float("nan"), float("nan")
        k = int(self.contact.largest_stretch.argmax())
        x, y = self.contact.largest_stretch_at[k]
        return float(self.contact.largest_stretch[k]), float(x), float(y)

    @property
    def stretch_measure(self) -> float:
        """The stretch that a thousandth of the volume exceeds, at its largest over the path."""
        values = self.contact.stretch_measure
        return float(values.max()) if len(values) else float("nan")

    @property
    def complete(self) -> bool:
        """Whether both paths reached every displacement."""
        return self.third_medium.complete and self.contact.complete

    @property
    def message(self) -> str:
        """Where and why a path ended, if one did."""
        return endings({"third medium": self.third_medium, "real contact": self.contact})

    @property
    def remarks(self) -> tuple[str, ...]:
        """A plain sentence for each control point that deviates by more than 5 %, and more.

        A wall thinner than l_i is all interface: the optimiser never saw it as solid. And a law is
        good for nothing where it is not stable.
        """
        found = []
        for verdict in self.points:
            if not np.isfinite(verdict.q_contact):
                found.append(f"the solid's path did not reach d = {verdict.point.d:g} mm.")
            elif abs(verdict.relative) > REMARKABLE:
                word = "stiffer" if verdict.relative > 0 else "softer"
                found.append(
                    f"At d = {verdict.point.d:g} mm the solid is {100 * abs(verdict.relative):.1f}"
                    f" % {word} than the third medium says"
                    f" ({significant(verdict.q_contact, 4)} against"
                    f" {significant(verdict.q_third_medium, 4)} N)."
                )
        if self.smallest_wall < self.design.problem.l_i:
            found.append(
                f"The smallest wall ({self.smallest_wall:.3g} mm) is thinner than the interface l_i"
                f" ({self.design.problem.l_i:.3g} mm): it was grey to the optimiser. Repeat with"
                " more elements and a smaller l_i before making the part."
            )
        problem = self.design.problem
        for kind, size in (("wall", self.smallest_wall), ("gap", self.smallest_gap)):
            wanted = getattr(problem, kind)
            if size < (1 - THINNER) * wanted:
                found.append(
                    f"The smallest {kind} ({size:.3g} mm) is thinner than asked for"
                    f" ({kind} = {wanted:g} mm)."
                )
        unstable = instability(problem.law, self.stretch_measure, problem.motion)
        return (*found, unstable) if unstable else tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Everything in JSON types; what is not a finite number is None."""
        quality = self.body.quality
        place, far, relative = self.largest_deviation
        stretch, x, y = self.largest_stretch
        d, q, q_contact = self.path
        contact = self.contact
        return {
            "name": self.design.problem.name,
            "level": self.body.level,
            "control_points": [
                {
                    "d": verdict.point.d,
                    "q_target": verdict.point.q,
                    "q_third_medium": finite_or_none(verdict.q_third_medium),
                    "q_contact": finite_or_none(verdict.q_contact),
                    "deviation": finite_or_none(verdict.deviation),
                    "relative_deviation": finite_or_none(verdict.relative),
                }
                for verdict in self.points
            ],
            "largest_deviation": {
                "d": finite_or_none(place),
                "deviation": finite_or_none(far),
                "relative": finite_or_none(relative),
            },
            "contact_starts": list(contact.contact_starts),
            "largest_stretch": {
                "value": finite_or_none(stretch),
                "x": finite_or_none(x),
                "y": finite_or_none(y),
            },
            "stretch_measure": finite_or_none(self.stretch_measure),
            "smallest_wall": finite_or_none(self.smallest_wall),
            "smallest_gap_at_rest": finite_or_none(self.smallest_gap),
            "smallest_gap": finite_or_none(float(np.min(contact.smallest_gap, initial=np.inf))),
            "force_balance": finite_or_none(_largest(contact.q_bottom - contact.q)),
            "stress_balance": finite_or_none(_largest(contact.q_stress - contact.q)),
            "side_stress_error": finite_or_none(_largest(contact.q_side - contact.q)),
            "mesh": {
                "elements": None if quality is None else quality.elements,
                "smallest_angle": None
                if quality is None
                else finite_or_none(quality.smallest_angle),
                "elements_across": None if quality is None else quality.elements_across,
                "area_error": None if quality is None else finite_or_none(quality.area_error),
            },
            "curve": {
                "d": [float(v) for v in d],
                "q_third_medium": [float(v) for v in q],
                "q_contact": [float(v) for v in q_contact],
            },
            "complete": self.complete,
            "message": self.message,
            "remarks": list(self.remarks),
        }


def verify(
    design: Design,
    displacements: Iterable[float] | None = None,
    *,
    points: int = 21,
    level: float = 0.0,
    elements_across: int = 4,
    settings: ContactSettings | None = None,
    threads: int | None = None,
    folder: Path | None = None,
) -> Verification:
    """Remodel a design with a body-fitted mesh and real contact, and compare the curves.

    Parameters
    ----------
    design : Design
    displacements : iterable of float, optional
        Displacements in mm; by default ``points`` evenly spaced ones between the outermost
        control points (and zero), the control points, and zero.
    points : int
        See ``displacements``.
    level, elements_across
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    settings : ContactSettings, optional
    threads : int, optional
        See `ngspring.optimize`.
    folder : path, optional
        Of the design's file: a load path of the third medium that is stored there, or with the
        gallery, is not computed again.

    Raises
    ------
    OutlineError
        If the design is empty, full, grey or not connected.
    ProblemError
        If a displacement is not a finite number smaller than H in size.
    """
    if displacements is None:
        displacements = path_displacements(design, points)
    wanted = list(displacements)
    body = mesh_body(design, level=level, elements_across=elements_across)
    contact = contact_load_displacement(body, wanted, settings=settings, threads=threads)
    third_medium = curve_of(design, wanted, folder, threads)
    quality = body.quality
    assert quality is not None  # the mesh was made here
    return Verification(
        design, body, third_medium, contact, quality.thinnest_wall, quality.narrowest_gap
    )


def largest_deviation(
    d: FloatArray, q: FloatArray, q_contact: FloatArray
) -> tuple[float, float, float]:
    """Where two curves are furthest apart in force.

    Parameters
    ----------
    d, q, q_contact : arrays (points,)
        Displacements in mm, and forces in N by the third medium and by real contact.

    Returns
    -------
    d, deviation, relative : float
        See `Verification.largest_deviation`; NaN for empty curves, and the last one where q = 0.
    """
    if not len(d):
        return float("nan"), float("nan"), float("nan")
    k = int(np.abs(q_contact - q).argmax())
    far, relative = deviation(q_contact[k], q[k]), relative_deviation(q_contact[k], q[k])
    return float(d[k]), float(far), float(relative)


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))
