"""Bodies made of others: the whole of a quarter, and one whose surface is moved.

The mesh is the same one, deformed, node by node: nothing moved gives the same mesh to the last bit,
and a little gives one so near that two results differ as the shapes do, not as meshes do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.quality import smallest_jacobian
from ngspring.solid.mesh.triangles import NAMES, TriangleMesh, mirrored, to_ngsolve
from ngspring.solid.sides import SIDES, SURFACE

#: Where the surface meets a side at a small angle, its end moves along the side no further than the
#: distance over this sine.
_GRAZING = 0.5

#: From places (n, 2) in mm to the distances (n,) in mm by which surfaces move outwards there.
Distance = Callable[[FloatArray], FloatArray]


def whole_body(body: Body) -> Body:
    """A symmetric body with its mirror images, all on one mesh.

    Parameters
    ----------
    body : Body
        Of `ngspring.solid.mesh.mesh_body.mesh_body`.

    Raises
    ------
    ProblemError
        If the body has no mesh as arrays.
    """
    sector = body.problem.sector
    whole = mirrored(_arrays(body), sector)
    if whole is body.triangles:
        return body
    problem = body.problem.replace(domain="full")
    return Body(problem, to_ngsolve(whole), body.level, None, whole)


def _arrays(body: Body) -> TriangleMesh:
    if body.triangles is None:
        raise ProblemError("the body has no mesh as arrays: make it with mesh_body")
    return body.triangles


def moved_body(body: Body, distance: Distance) -> Body:
    """The body with its free surface moved outwards.

    Ends of the surface on a side of the meshed part stay on it, and what lies between them on the
    side is stretched evenly; inside, nodes move as a harmonic function does.

    Parameters
    ----------
    body : Body
        Of `ngspring.solid.mesh.mesh_body.mesh_body`.
    distance : callable
        From places (n, 2) in mm to distances (n,) in mm, negative inwards.

    Raises
    ------
    ProblemError
        If the body has no mesh as arrays.
    OutlineError
        If a distance is so large that an element is turned inside out.
    """
    mesh = _arrays(body)
    size = np.array(body.problem.sector.size)
    moves = _inside(mesh, _on_sides(mesh, size, _of_surface(mesh, size, distance)))
    moved = replace(mesh, points=mesh.points + moves)
    if smallest_jacobian(moved) <= 0:
        far = float(np.abs(distance(mesh.points[_nodes(mesh, SURFACE)])).max(initial=0.0))
        raise OutlineError(
            f"surfaces moved by {far:g} mm turn an element of the mesh inside out: they are more"
            " strongly curved than that, so move them by less"
        )
    return Body(body.problem, to_ngsolve(moved), body.level, None, moved)


def _nodes(mesh: TriangleMesh, name: str) -> IntArray:
    """Nodes on the boundary edges of a name, edge middles included."""
    return np.unique(mesh.segments[mesh.names == NAMES.index(name)])


def _normals(mesh: TriangleMesh) -> FloatArray:
    """Outward unit normals (points, 2) of the free surface; zero elsewhere."""
    first, last, middle = mesh.segments[mesh.names == NAMES.index(SURFACE)].T
    x, y, m = mesh.points[first], mesh.points[last], mesh.points[middle]
    normals = np.zeros_like(mesh.points)
    for nodes, tangent in (
        (first, 4 * m - 3 * x - y),
        (last, 3 * y + x - 4 * m),
        (middle, y - x),
    ):
        # The solid is on the left.
        outward = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        np.add.at(normals, nodes, outward / np.linalg.norm(outward, axis=1, keepdims=True))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _of_surface(mesh: TriangleMesh, size: FloatArray, distance: Distance) -> FloatArray:
    """How the surface's nodes move (points, 2), its ends along their sides; zero elsewhere."""
    moves = np.zeros_like(mesh.points)
    nodes, normals = _nodes(mesh, SURFACE), _normals(mesh)
    moves[nodes] = distance(mesh.points[nodes])[:, None] * normals[nodes]
    for name, held in zip(SIDES, (0, 0, 1, 1), strict=True):
        ends = np.intersect1d(nodes, _nodes(mesh, name))
        along = 1 - held
        slant = normals[ends, along]
        share = 1 / np.copysign(np.maximum(np.abs(slant), _GRAZING), slant)
        moves[ends, along] = distance(mesh.points[ends]) * share
        moves[ends, held] = 0.0
    corner = ((mesh.points == 0.0) | (mesh.points == size)).all(axis=1)
    moves[corner] = 0.0
    return moves


def _on_sides(mesh: TriangleMesh, size: FloatArray, moves: FloatArray) -> FloatArray:
    """The same, with what lies on sides between the surface's ends."""
    moves = moves.copy()
    surface = _nodes(mesh, SURFACE)
    for name, along in zip(SIDES, (1, 1, 0, 0), strict=True):
        nodes = _nodes(mesh, name)
        ends = np.intersect1d(nodes, surface)
        order = np.argsort(mesh.points[ends, along])
        # A corner of the domain that the solid fills stays where it is.
        places = np.concatenate([[0.0], mesh.points[ends[order], along], [size[along]]])
        values = np.concatenate([[0.0], moves[ends[order], along], [0.0]])
        between = np.setdiff1d(nodes, ends)
        moves[between, along] = np.interp(mesh.points[between, along], places, values)
    return moves


def _inside(mesh: TriangleMesh, moves: FloatArray) -> FloatArray:
    """The same, with all other nodes: vertices by linear elements, edges stay straight."""
    n = mesh.vertices
    held = np.zeros(n, bool)
    on_boundary = np.unique(mesh.segments)
    held[on_boundary[on_boundary < n]] = True
    stiffness = _laplacian(mesh)
    moves = moves.copy()
    vertices = moves[:n]
    free = ~held
    inside = sp.csc_matrix(stiffness[free][:, free])
    vertices[free] = splu(inside).solve(-(stiffness[free][:, held] @ vertices[held]))
    ends = mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    middles = mesh.triangles[:, 3:].reshape(-1)
    inner = ~np.isin(middles, on_boundary)
    moves[middles[inner]] = moves[ends[inner]].mean(axis=1)
    return moves


def _laplacian(mesh: TriangleMesh) -> sp.csr_matrix:
    """Stiffness (vertices, vertices) of the Laplacian by linear triangles."""
    corners = mesh.triangles[:, :3]
    p = mesh.points[corners]
    opposite = p[:, [2, 0, 1]] - p[:, [1, 2, 0]]
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    local = np.einsum("tik,tjk->tij", opposite, opposite) / (2 * twice)[:, None, None]
    rows, columns = np.repeat(corners, 3, axis=1), np.tile(corners, 3)
    shape = (mesh.vertices, mesh.vertices)
    return sp.csr_matrix((local.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
