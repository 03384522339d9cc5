"""What the solid of a design carries at its control points, by real contact (3.5)."""

from __future__ import annotations

import math

import numpy as np

from ngspring.analysis.states import force_at
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError
from ngspring.design.corrections import of_part
from ngspring.design.design import Design
from ngspring.solid.contact.response import ContactSettings, contact_load_displacement
from ngspring.solid.mesh.mesh_body import mesh_body


def solid_forces(
    design: Design,
    *,
    elements_across: int = 4,
    settings: ContactSettings | None = None,
    threads: int | None = None,
) -> tuple[FloatArray, str]:
    """Forces of the remodelled solid at the control points without an offset eta.

    Parameters
    ----------
    design : Design
    elements_across
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    settings : ContactSettings, optional
    threads : int, optional
        See `ngspring.optimize`.

    Returns
    -------
    q : array (control points,)
        In N; NaN where the solid's path did not get there, and at those with an offset eta.
    message : str
        Why it did not, if so.
    """
    points = design.problem.control_points
    own = of_part(points)
    q = np.full(len(points), np.nan)
    try:
        body = mesh_body(design, elements_across=elements_across)
    except OutlineError as error:
        return q, str(error)
    places = [points[j].d for j in own]
    curve = contact_load_displacement(
        body, places, settings=settings, threads=threads, onset=math.inf
    )
    q[own] = [force_at(curve, d) for d in places]
    return q, curve.message
