"""Is a design a part? Its solid has to join both ends, and to carry the load in black."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ngspring.design.corrections import MISSED
from ngspring.design.design import Design

#: A density between these is grey.
GREY = (0.1, 0.9)
#: Largest share of the strain energy in grey. The finished designs of the gallery have 0.02 to 0.1
#: in the edges of their walls, T1 with its neck of density 0.95 has 0.2, walls of two or three l_i
#: on coarse meshes up to 0.3, and what hangs on hinges of density 1/2 has half of it there.
LARGEST_SHARE = 0.4

#: Samples of chi along an element; and halvings, for a density to 1e-4.
_PER_ELEMENT, _HALVINGS = 4, 14


def neck_density(design: Design) -> float:
    """Largest density of which material joins bottom and top.

    Every way from end to end leads through material of this density or less: 1 for a black part,
    and less than 1/2 if {chi > 0} is not connected.
    """
    # It takes as long to import as all else that a picture needs.
    from scipy import ndimage

    problem = design.problem
    n = _PER_ELEMENT * problem.elements + 1
    x, y = np.linspace(0.0, problem.L, n), np.linspace(0.0, problem.H, n)
    density = design.density(x[:, None], y[None, :])
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        parts, _ = ndimage.label(density > middle)
        joined = np.intersect1d(parts[:, 0], parts[:, -1]).any()
        low, high = (middle, high) if joined else (low, middle)
    return low


def flaw(design: Design, shares: Sequence[float] | None = None) -> str:
    """Why a design is no part, or misses its targets as one, in one clause; empty if it is one.

    Parameters
    ----------
    design : Design
    shares : sequence of float, optional
        Share of the strain energy in grey (`GREY`) at each control point without an offset eta; by
        default what a run has noted of its design, if it has.
    """
    neck = neck_density(design)
    if neck <= 0.5:
        return "its solid is not connected: no part of {chi > 0} joins bottom and top"
    if design.info.get(MISSED):
        return str(design.info[MISSED])
    if design.solid is not None:
        # What the solid carries is known: it does not hang on grey.
        return ""
    if neck < GREY[1]:
        return (
            "it carries its load through grey: every way from end to end leads through a density of"
            f" {neck:.2f} or less"
        )
    noted = design.info.get("grey", ()) if shares is None else shares
    places = [point.d for point in design.problem.control_points if point.own]
    if len(noted) != len(places) or not max(noted, default=0.0) > LARGEST_SHARE:
        return ""
    share, d = max(zip(noted, places, strict=True))
    return (
        f"it carries its load through grey: {share:.0%} of the strain energy at d = {d:g} mm is in"
        f" material of a density between {GREY[0]:g} and {GREY[1]:g}"
    )
