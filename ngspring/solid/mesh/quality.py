"""How good a body-fitted mesh is: angles, Jacobians, elements across walls, area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.solid.mesh.triangles import TriangleMesh, mirrored
from ngspring.solid.mesh.wallsize import Boundary
from ngspring.solid.outline.levelset import LevelSet


@dataclass(frozen=True)
class MeshQuality:
    """Measures of a body-fitted mesh.

    Attributes
    ----------
    elements, nodes : int
        Number of triangles and of their nodes, edge middles included.
    smallest_angle : float
        In degrees, between the curved edges.
    smallest_jacobian : float
        Smallest Jacobian determinant of an element relative to the element's largest one, by
        bounds on the quadratic polynomial: positive if no element is turned inside out anywhere,
        1 for straight elements.
    elements_across : int
        Fewest edges from node to node between the faces of a wall.
    thinnest_wall : float
        Smallest distance in mm between the two faces of a wall, or infinity without walls: the
        diameter of the smallest disc in the solid that touches two opposite surfaces.
    narrowest_gap : float
        The same for the void: between two surfaces that face each other, undeformed, if the disc
        is not larger than the domain.
    area : float
        Of the mesh in mm^2.
    area_error : float
        ``area`` relative to the area of {chi > level} by quadrature of chi, minus one.
    smallest_edge, largest_edge : float
        In mm.
    """

    elements: int
    nodes: int
    smallest_angle: float
    smallest_jacobian: float
    elements_across: int
    thinnest_wall: float
    narrowest_gap: float
    area: float
    area_error: float
    smallest_edge: float
    largest_edge: float


def quality_of(mesh: TriangleMesh, area: float, across: int, boundary: Boundary) -> MeshQuality:
    """Measure a mesh of a solid of this area (mm^2) and boundary."""
    jacobian = _jacobian_bounds(mesh)
    p = mesh.points[mesh.triangles]
    edges = np.linalg.norm(p[:, [1, 2, 0]] - p[:, [0, 1, 2]], axis=2)
    measured = float(jacobian.mean(axis=1).sum() / 2)
    return MeshQuality(
        elements=len(mesh.triangles),
        nodes=len(mesh.points),
        smallest_angle=float(np.degrees(_angles(p).min())),
        smallest_jacobian=smallest_jacobian(mesh),
        elements_across=across,
        thinnest_wall=float(boundary.thickness.min()),
        narrowest_gap=float(boundary.gap.min()),
        area=measured,
        area_error=measured / area - 1,
        smallest_edge=float(edges.min()),
        largest_edge=float(edges.max()),
    )


def smallest_jacobian(mesh: TriangleMesh) -> float:
    """See `MeshQuality.smallest_jacobian`."""
    bounds = _jacobian_bounds(mesh)
    return float((bounds.min(axis=1) / np.abs(bounds).max(axis=1)).min())


def _jacobian_bounds(mesh: TriangleMesh) -> FloatArray:
    """Bernstein coefficients (m, 6) of each element's Jacobian determinant."""
    p = mesh.points[mesh.triangles]
    values = np.empty((len(p), 6))
    places = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)]
    for k, (s, t) in enumerate(places):
        # Derivatives of the quadratic shape functions of the nodes a, b, c, ab, bc, ca.
        r = 1 - s - t
        by_s = [1 - 4 * r, 4 * s - 1, 0.0, 4 * (r - s), 4 * t, -4 * t]
        by_t = [1 - 4 * r, 0.0, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)]
        d_s, d_t = (np.einsum("j,njk->nk", np.array(w), p) for w in (by_s, by_t))
        values[:, k] = d_s[:, 0] * d_t[:, 1] - d_s[:, 1] * d_t[:, 0]
    corner, middle = values[:, :3], values[:, 3:]
    return np.hstack([corner, 2 * middle - (corner + corner[:, [1, 2, 0]]) / 2])


def _angles(p: FloatArray) -> FloatArray:
    """Angles (m, 3) between the curved edges of each element at its vertices, in rad."""
    result = np.empty((len(p), 3))
    for k in range(3):
        here, ahead, behind = p[:, k], p[:, (k + 1) % 3], p[:, (k + 2) % 3]
        a = 4 * p[:, 3 + k] - 3 * here - ahead
        b = 4 * p[:, 3 + (k + 2) % 3] - 3 * here - behind
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        result[:, k] = np.arctan2(cross, (a * b).sum(axis=1))
    return result


def layers_across(mesh: TriangleMesh, boundary: Boundary, ls: LevelSet) -> IntArray:
    """Elements across the wall at each point of the boundary; 0 where no wall begins.

    The number of edges on the shortest way through the mesh from the node nearest to the point to
    the nodes of the opposite surface within reach of the disc that measures the wall.
    """
    whole = mirrored(mesh, ls.problem.sector, axis_too=True)
    n = whole.vertices
    a, b = whole.triangles[:, [0, 1, 2]].ravel(), whole.triangles[:, [1, 2, 0]].ravel()
    ones = np.ones(len(a), np.int8)
    graph = sp.csr_matrix((ones, (a, b)), shape=(n, n))
    on_edge = np.unique(whole.segments[:, :2])
    tree = cKDTree(whole.points[on_edge])
    result = np.zeros(len(boundary.points), np.int64)
    wall = np.flatnonzero(boundary.opposite >= 0)
    if not wall.size:
        return result
    images = np.vstack(
        [offset + sign * boundary.points for sign, offset in ls.problem.sector.images()]
    )
    start = on_edge[tree.query(boundary.points[wall])[1]]
    end = on_edge[tree.query(images[boundary.opposite[wall]])[1]]
    sources, row = np.unique(start, return_inverse=True)
    steps = dijkstra(graph, directed=False, indices=sources, unweighted=True, limit=64)
    count = steps[row.reshape(-1), end]
    result[wall] = np.where(np.isfinite(count), count, 64)
    return result
