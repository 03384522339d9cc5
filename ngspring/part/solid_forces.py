"""What the solid of a design carries at its control points, by real contact (3.5)."""

from __future__ import annotations

import logging

import numpy as np

from ngspring.analysis.states import force_at
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError
from ngspring.design.design import Design
from ngspring.solid.contact.response import ContactSettings, contact_load_displacement
from ngspring.solid.mesh.mesh_body import mesh_body

logger = logging.getLogger(__name__)


def solid_forces(
    design: Design,
    *,
    elements_across: int = 4,
    settings: ContactSettings | None = None,
    threads: int | None = None,
) -> tuple[FloatArray, str]:
    """Forces of the remodelled solid at every control point.

    At a control point with an offset eta the solid is {chi + eta > 0}, as the design that is
    loaded there (2.6).

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
        In N; NaN where the solid's path did not get there.
    message : str
        Why it did not, if so.
    """
    points = design.problem.control_points
    q = np.full(len(points), np.nan)
    messages = []
    for eta in dict.fromkeys(point.eta for point in points):
        mine = [j for j, point in enumerate(points) if point.eta == eta]
        try:
            body = mesh_body(design, level=0.0 - eta, elements_across=elements_across)
        except OutlineError as error:
            messages.append(str(error))
            continue
        displacements = [points[j].d for j in mine]
        curve = contact_load_displacement(body, displacements, settings=settings, threads=threads)
        q[mine] = [force_at(curve, d) for d in displacements]
        if curve.message:
            messages.append(curve.message)
    return q, "; ".join(messages)
