"""What a small imperfection does to a solid: whether it stays on the path of the perfect one.

Springs are designed on their symmetric path. Where that is unstable, the smallest error of the
mould decides where the spring goes. So the whole solid is computed, with no symmetry assumed, with
surfaces moved by a fraction of a millimetre in a pattern that breaks symmetries, and with real
contact. A stable spring hardly notices; one that buckles leaves the curve that it was designed for.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngspring.analysis.path import Jump
from ngspring.analysis.states import common_path, endings, path_displacements
from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import positive_number
from ngspring.basics.files import finite_or_none
from ngspring.basics.text import significant
from ngspring.design.design import Design
from ngspring.problem.imperfection import checked_odd_in, odd_pattern, usual_odd_in
from ngspring.solid.contact.response import (
    ContactResponse,
    ContactSettings,
    contact_load_displacement,
)
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.mesh.moved import moved_body, whole_body

#: A stable spring's force stays so near to that of the perfect one, as a share of it.
STABLE = 0.02
#: Forces smaller than this share of the curve's largest one are not divided by: a curve may go
#: through zero.
_SMALL_FORCE = 0.1


@dataclass(frozen=True, eq=False)
class Imperfection:
    """Outcome of `imperfection`: the imperfect solid beside the perfect one.

    Attributes
    ----------
    design : Design
    size : float
        Largest distance in mm by which surfaces are moved.
    odd_in : {"xy", "x", "y"}
        In which axes the pattern is odd, see `ngspring.problem.imperfection.odd_pattern`.
    perfect, imperfect : ContactResponse
        Curves of both, at the same displacements as far as they got.
    """

    design: Design
    size: float
    odd_in: str
    perfect: ContactResponse
    imperfect: ContactResponse

    @property
    def path(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """d, q of the perfect and q of the imperfect solid where both were reached."""
        return common_path(self.perfect, self.imperfect)

    @property
    def deviations(self) -> FloatArray:
        """How far the imperfect solid's force is off at the displacements of `path`, as shares.

        Of the perfect one's there, or of a tenth of its largest where that is more; positive where
        the imperfect solid is stiffer or stronger.
        """
        _, q, other = self.path
        size = np.maximum(np.abs(q), _SMALL_FORCE * np.abs(q).max(initial=0.0))
        sign = np.where(q < 0.0, -1.0, 1.0)
        return np.asarray(sign * (other - q) / np.where(size > 0.0, size, 1.0))

    @property
    def largest_deviation(self) -> tuple[float, float]:
        """Where in mm the force is furthest off, and by what share; NaN if nothing was reached."""
        d, far = self.path[0], self.deviations
        if not len(d):
            return float("nan"), float("nan")
        k = int(np.abs(far).argmax())
        return float(d[k]), float(far[k])

    @property
    def leaves(self) -> tuple[float, ...]:
        """The first displacements in mm where the force is off by more than `STABLE`.

        At most one in compression and one in tension, among the displacements that were asked for.
        """
        d, far = self.path[0], np.abs(self.deviations)
        beyond = d[far > STABLE]
        sides = (beyond[beyond < 0.0], beyond[beyond > 0.0])
        return tuple(float(side[np.abs(side).argmin()]) for side in sides if len(side))

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Where the imperfect solid snaps."""
        return self.imperfect.jumps

    @property
    def stable(self) -> bool:
        """Whether the imperfect solid follows the perfect one to the end."""
        return self.complete and not self.leaves and not self.jumps

    @property
    def complete(self) -> bool:
        """Whether both paths reached every displacement."""
        return self.perfect.complete and self.imperfect.complete

    @property
    def message(self) -> str:
        """Where and why a path ended, if one did."""
        return endings({"perfect": self.perfect, "imperfect": self.imperfect})

    @property
    def pattern(self) -> str:
        """What was done to the surfaces, in words."""
        return f"surfaces moved by up to {self.size:g} mm, odd in {' and '.join(self.odd_in)}"

    @property
    def verdict(self) -> str:
        """A plain sentence on whether the spring is stable."""
        place, share = self.largest_deviation
        if not np.isfinite(place):
            return "no force of the imperfect solid is known."
        off = f"{100 * abs(share):.2g} % at d = {place:g} mm"
        if self.stable:
            return f"With {self.pattern}, the force stays within {off}: stable."
        parts = []
        if self.leaves:
            where = " and ".join(f"{d:g}" for d in self.leaves)
            parts.append(f"the force is off by more than {100 * STABLE:g} % from d = {where} mm on")
        parts.append(f"by at most {off}" if self.leaves else f"the force is off by at most {off}")
        snaps = " and ".join(significant(jump.d, 4) for jump in self.jumps)
        parts += [f"it snaps at d = {snaps} mm"] if snaps else []
        parts += [] if self.complete else ["a path ends early"]
        return f"With {self.pattern}, {', '.join(parts)}."

    def to_dict(self) -> dict[str, Any]:
        """Everything in JSON types; what is not a finite number is None."""
        d, perfect, imperfect = self.path
        place, share = self.largest_deviation
        return {
            "name": self.design.problem.name,
            "level": self.perfect.body.level,
            "size": self.size,
            "odd_in": self.odd_in,
            "stable": self.stable,
            "largest_deviation": {"d": finite_or_none(place), "relative": finite_or_none(share)},
            "leaves": list(self.leaves),
            "jumps": [
                {"d": jump.d, "q_before": jump.q_before, "q_after": jump.q_after}
                for jump in self.jumps
            ],
            "contact_starts": list(self.imperfect.contact_starts),
            "curve": {
                "d": [float(x) for x in d],
                "q_perfect": [float(q) for q in perfect],
                "q_imperfect": [float(q) for q in imperfect],
                "deviation": [float(x) for x in self.deviations],
            },
            "complete": self.complete,
            "message": self.message,
        }


def imperfection(
    design: Design,
    size: float,
    displacements: Iterable[float] | None = None,
    *,
    odd_in: str | None = None,
    points: int = 21,
    level: float = 0.0,
    elements_across: int = 4,
    settings: ContactSettings | None = None,
    threads: int | None = None,
    perfect: ContactResponse | None = None,
) -> Imperfection:
    """The whole solid with an imperfection, by real contact, beside the perfect one.

    Surfaces are moved outwards along their normals by ``size`` times
    `ngspring.problem.imperfection.odd_pattern`, and inwards at the mirror image, on the mesh of
    the perfect solid.

    Parameters
    ----------
    design : Design
    size : float
        Largest distance in mm by which surfaces are moved.
    displacements : iterable of float, optional
        In mm; by default ``points`` evenly spaced ones between the outermost control points (and
        zero), the control points, and zero.
    odd_in : {"xy", "x", "y"}, optional
        Which symmetries are broken; both by default, or that in y of a body of revolution.
    points : int
        See ``displacements``.
    level, elements_across
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    settings : ContactSettings, optional
    threads : int, optional
        See `ngspring.optimize`.
    perfect : ContactResponse, optional
        The perfect solid's curve at these displacements if it is there already, as
        `Verification.contact`; its body is taken then.

    Returns
    -------
    Imperfection

    Raises
    ------
    ProblemError
        If the size is not positive, a displacement is not a finite number smaller than H in size,
        or the pattern does not fit the kinematics.
    OutlineError
        If the solid cannot be meshed, or its surfaces cannot be moved so far.
    """
    size = positive_number("imperfection", size)
    axis = design.problem.motion.axis
    odd_in = usual_odd_in(axis) if odd_in is None else checked_odd_in("odd_in", odd_in, axis)
    if displacements is None:
        displacements = path_displacements(design, points)
    wanted = list(displacements)
    if perfect is None:
        body = mesh_body(design, level=level, elements_across=elements_across)
        perfect = contact_load_displacement(body, wanted, settings=settings, threads=threads)
    body = imperfect_body(perfect.body, size, odd_in)
    imperfect = contact_load_displacement(body, wanted, settings=settings, threads=threads)
    return Imperfection(design, size, odd_in, perfect, imperfect)


def imperfect_body(body: Body, size: float, odd_in: str = "xy") -> Body:
    """The whole of a symmetric body with its surfaces moved in an odd pattern.

    Parameters
    ----------
    body : Body
        Of `ngspring.solid.mesh.mesh_body.mesh_body`, a quarter or the whole.
    size : float
        Largest distance in mm.
    odd_in : {"xy", "x", "y"}

    Raises
    ------
    OutlineError
        If surfaces cannot be moved so far.
    """
    whole = whole_body(body)
    L, H = body.problem.L, body.problem.H

    def distance(places: FloatArray) -> FloatArray:
        return np.asarray(size * odd_pattern(places[:, 0], places[:, 1], L, H, odd_in))

    return moved_body(whole, distance)
