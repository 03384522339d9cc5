"""How a spring's solid is held and moved: 2.5 where the solid reaches the domain's sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ProblemError
from ngspring.fem.constraints import DisplacementExtraction
from ngspring.fem.grid import Grid
from ngspring.solid.contact.elasticity import numbered
from ngspring.solid.mesh.body import Body
from ngspring.solid.sides import SIDES


@dataclass(frozen=True)
class Plane:
    """A plane that the surface may not pass: a mirror line, or a side of the domain.

    Attributes
    ----------
    name : str
        Which side.
    normal : tuple of float
        Unit normal, along an axis, from the plane into the solid's side.
    offset : float
        ``normal . x`` of the plane at rest, in mm.
    dof : int or None
        Dof of the VectorH1 space with which the plane moves along its axis.
    """

    name: str
    normal: tuple[float, float]
    offset: float
    dof: int | None = None


@dataclass(frozen=True, eq=False)
class Supports:
    """Constraints and planes of a spring's solid.

    Attributes
    ----------
    extraction : DisplacementExtraction
        Dofs <- free unknowns and d.
    floating : int array
        See `ngspring.solid.contact.elasticity.Solid`.
    planes : tuple of Plane
        What a void cut by a side closes on: its own mirror image.
    top, bottom : int arrays
        Vertical dofs of the vertices on the two loaded sides: the sum of the forces on them is
        the force on the side, since the edges' bubbles do not take part in a shift.
    top_share : float
        Displacement of the meshed part's top side at d = 1: 1/2 on the quarter.
    """

    extraction: DisplacementExtraction
    floating: IntArray
    planes: tuple[Plane, ...]
    top: IntArray
    bottom: IntArray
    top_share: float


def dofs_on(space: ng.FESpace, mesh: Any, name: str) -> IntArray:
    """Dofs of a scalar space on the boundary pieces of this name."""
    if name not in mesh.GetBoundaries():
        return np.zeros(0, np.int64)
    return np.flatnonzero(np.array(space.GetDofs(mesh.Boundaries(name)), bool)).astype(np.int64)


def dof_places(mesh: Any) -> FloatArray:
    """Place in mm of each dof of H1(order=2) on triangles: vertices, then middles of chords."""
    points = np.array([v.point for v in mesh.vertices])
    edges = np.array([[v.nr for v in e.vertices] for e in mesh.edges])
    return np.concatenate([points, points[edges].mean(axis=1)])


def spring_supports(body: Body) -> Supports:
    """Boundary conditions of 2.5 for the solid of a spring, or their symmetric part.

    Where the solid does not reach the left side, nothing is tied to u_Lx, and there is no plane:
    it would follow any push without force.

    Raises
    ------
    ProblemError
        If the solid does not reach both loaded sides.
    """
    mesh, grid = body.mesh, Grid(body.problem)
    scalar = ng.H1(mesh, order=2)
    n, vertices = int(scalar.ndof), int(mesh.nv)
    sides = {name: dofs_on(scalar, mesh, name) for name in SIDES}
    for name in ("bottom", "top"):
        if not len(sides[name]):
            raise ProblemError(f"the solid does not reach the {name} side, so it carries no load")
    left, right, bottom, top = (sides[name] for name in SIDES)
    places = dof_places(mesh)
    width, height = grid.size
    parent, weight = np.arange(2 * n), np.ones(2 * n)

    def tie(dofs: IntArray, to: int, factor: float) -> None:
        vertex = dofs % n < vertices
        parent[dofs[vertex]] = to
        weight[dofs[vertex]] = factor
        weight[dofs[~vertex]] = 0.0

    if not grid.sector.half_height:
        pairs = matching(places, vertices, top, bottom, 0, 1e-6 * height)
        parent[pairs[:, 0]] = pairs[:, 1]
    u_lx = next((int(dofs[0]) for dofs in (left, right) if len(dofs)), None)
    if u_lx is not None:
        tie(left, u_lx, 1.0)
    if grid.sector.half_width:
        weight[right] = 0.0
    elif u_lx is not None:
        tie(right, u_lx, -1.0 if len(left) else 1.0)
        pairs = matching(places, vertices, right, left, 1, 1e-6 * height)
        parent[n + pairs[:, 0]] = n + pairs[:, 1]
    share = grid.sector.share
    u_ty = n + int(top[0])
    weight[n + bottom] = 0.0
    tie(n + top, u_ty, share)
    extraction, unknown = numbered(parent, weight, u_ty)

    planes = [Plane("bottom", (0.0, 1.0), 0.0), Plane("top", (0.0, -1.0), -height, u_ty)]
    if any(mirror.axis == 0 and not mirror.rotation for mirror in grid.sector.mirrors):
        planes.append(Plane("right", (-1.0, 0.0), -width))
    if len(left):
        planes.append(Plane("left", (1.0, 0.0), 0.0, int(left[0])))
    if not grid.sector.half_width and len(right):
        planes.append(Plane("right", (-1.0, 0.0), -width, int(right[0])))
    floating = np.zeros(0, np.int64)
    if not grid.sector.rotation:
        floating = _floating(mesh, extraction, unknown, n)
    on_top, on_bottom = (n + dofs[dofs < vertices] for dofs in (top, bottom))
    return Supports(extraction, floating, tuple(planes), on_top, on_bottom, share)


def matching(
    places: FloatArray,
    vertices: int,
    dofs: IntArray,
    others: IntArray,
    axis: int,
    tolerance: float,
) -> IntArray:
    """Pairs (pairs, 2) of dofs of two opposite sides with the same coordinate along `axis`.

    Vertices (the first dofs) are paired with vertices, edge bubbles with edge bubbles.
    """
    if not len(dofs) or not len(others):
        return np.zeros((0, 2), np.int64)
    distance = abs(places[dofs, axis][:, None] - places[others, axis])
    distance[(dofs < vertices)[:, None] != (others < vertices)] = np.inf
    nearest = distance.argmin(axis=1)
    found = distance[np.arange(len(dofs)), nearest] < tolerance
    return np.stack([dofs[found], others[nearest[found]]], axis=1)


def _floating(mesh: Any, extraction: DisplacementExtraction, unknown: IntArray, n: int) -> IntArray:
    """One horizontal unknown of every part of the solid that can be shifted as a whole."""
    vertices = int(mesh.nv)
    edges = np.array([[v.nr for v in e.vertices] for e in mesh.edges])
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(vertices, vertices))
    count, part = connected_components(graph, directed=False)
    found = []
    for k in range(count):
        shift = np.zeros(2 * n)
        shift[:vertices][part == k] = 1.0
        allowed = extraction.matrix @ extraction.restrict(shift)
        if np.array_equal(allowed, shift):
            found.append(int(unknown[np.flatnonzero(shift)[0]]))
    return np.array(sorted(set(found)), dtype=np.int64)
