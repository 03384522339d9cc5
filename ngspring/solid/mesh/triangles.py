"""Second-order triangle meshes as arrays, their mirror images, and NGSolve meshes of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import netgen.meshing as nm
import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.problem.sector import Mirror, Sector
from ngspring.solid.outline.levelset import LevelSet
from ngspring.solid.sides import SIDES, SURFACE

NAMES = (*SIDES, SURFACE)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A mesh of triangles with a node in the middle of every edge.

    Attributes
    ----------
    points : array (n, 2)
        Vertices first, then edge middles, in mm.
    vertices : int
        Number of vertices.
    triangles : int array (m, 6)
        Counter-clockwise vertices a, b, c, then the middles of ab, bc, ca.
    segments : int array (k, 3)
        Boundary edges with the solid on the left: ends, then the middle.
    names : int array (k,)
        Index into `NAMES` of each boundary edge.
    quarter_elements : int
        Number of triangles before mirroring.
    """

    points: FloatArray
    vertices: int
    triangles: IntArray
    segments: IntArray
    names: IntArray
    quarter_elements: int

    @property
    def parts(self) -> int:
        """Number of connected parts."""
        n = len(self.points)
        a, b = self.triangles[:, :-1].ravel(), self.triangles[:, 1:].ravel()
        graph = sp.csr_matrix((np.ones(len(a), np.int8), (a, b)), shape=(n, n))
        return int(connected_components(graph, directed=False, return_labels=False))

    @classmethod
    def from_netgen(cls, mesh: nm.Mesh, ls: LevelSet) -> TriangleMesh:
        """Take over a straight mesh in units of a level set.

        All boundary nodes are moved onto the contour of chi, or onto their side.
        """
        corners = np.array(mesh.Coordinates())[:, :2] * ls.unit
        linear = np.array([[p.nr for p in el.vertices] for el in mesh.Elements2D()]) - 1
        edges = np.array([[p.nr for p in el.vertices] for el in mesh.Elements1D()]) - 1
        number = np.array([el.index for el in mesh.Elements1D()])
        names = np.array([NAMES.index(mesh.GetBCName(k - 1)) for k in range(1, number.max() + 1)])
        names = names[number - 1]
        a, b, c = (corners[linear[:, k]] for k in range(3))
        turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
        linear[turned] = linear[turned][:, [0, 2, 1]]
        used, inverse = np.unique(linear, return_inverse=True)
        renumber = np.full(len(corners), -1)
        renumber[used] = np.arange(len(used))
        corners, linear, edges = corners[used], inverse.reshape(-1, 3), renumber[edges]
        free = names == NAMES.index(SURFACE)
        on_side = np.unique(edges[~free])
        for name, axis, place in zip(
            SIDES, (0, 0, 1, 1), (0.0, ls.size[0], 0.0, ls.size[1]), strict=True
        ):
            corners[edges[names == NAMES.index(name)], axis] = place
        off = np.setdiff1d(np.unique(edges[free]), on_side)
        corners[off] = ls.project(corners[off])
        return _with_middles(corners, linear, edges, names, ls)


def _with_middles(
    corners: FloatArray, linear: IntArray, edges: IntArray, names: IntArray, ls: LevelSet
) -> TriangleMesh:
    n = len(corners)
    sides = linear[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs, middle = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    middle = middle.reshape(-1)
    points = corners[pairs].mean(axis=1)
    key = pairs[:, 0] * n + pairs[:, 1]
    low, high = edges.min(axis=1), edges.max(axis=1)
    of_edge = np.searchsorted(key, low * n + high)
    # The solid is on the left where the edge runs as in its triangle.
    forward = np.zeros(len(pairs), bool)
    forward[middle[sides[:, 0] < sides[:, 1]]] = True
    count = np.bincount(middle)
    ahead = forward[of_edge]
    if (count[of_edge] != 1).any():
        raise AssertionError("a boundary edge belongs to two triangles")
    ordered = np.where(ahead[:, None], np.column_stack([low, high]), np.column_stack([high, low]))
    free = names == NAMES.index(SURFACE)
    mine = of_edge[free]
    half = np.linalg.norm(corners[edges[free, 0]] - corners[edges[free, 1]], axis=1) / 2
    moved, reached = ls.approach(points[mine], reach=half)
    points[mine] = np.where(reached[:, None], moved, points[mine])
    return TriangleMesh(
        np.vstack([corners, points]),
        n,
        np.column_stack([linear, n + middle.reshape(-1, 3)]).astype(np.int64),
        np.column_stack([ordered, n + of_edge]).astype(np.int64),
        names,
        len(linear),
    )


def mirrored(mesh: TriangleMesh, sector: Sector, axis_too: bool = False) -> TriangleMesh:
    """The mesh together with its images at the mirror lines of the meshed part.

    Coordinates of images are ``L - x`` and ``H - y`` bit by bit; nodes on a mirror line are shared.
    The axis of an axisymmetric spring counts as a mirror line only if asked for.
    """
    for mirror in sector.mirrors:
        if axis_too or not mirror.rotation:
            mesh = _reflected(mesh, mirror)
    return mesh


def _reflected(mesh: TriangleMesh, mirror: Mirror) -> TriangleMesh:
    line = NAMES.index(mirror.side)
    total = len(mesh.points)
    shared = np.zeros(total, bool)
    shared[np.unique(mesh.segments[mesh.names == line])] = True
    shared |= mesh.points[:, mirror.axis] == mirror.size / 2
    images = mirror.places(mesh.points[~shared])
    is_vertex = np.arange(total) < mesh.vertices
    new_vertices = int((is_vertex & ~shared).sum())
    # Vertices stay in front: old ones, their images, old middles, their images.
    old = np.where(is_vertex, np.arange(total), np.arange(total) + new_vertices)
    image = old.copy()
    copied = np.flatnonzero(~shared)
    rank = np.arange(len(copied))
    image[copied] = np.where(copied < mesh.vertices, mesh.vertices, total) + rank
    points = np.empty((total + len(copied), 2))
    points[old] = mesh.points
    points[image[copied]] = images
    flip = [0, 2, 1, 5, 4, 3]
    kept = mesh.names != line
    names = mesh.names[kept]
    far_names = np.where(names == NAMES.index(mirror.far), line, names)
    segments = mesh.segments[kept]
    return TriangleMesh(
        points,
        mesh.vertices + new_vertices,
        np.vstack([old[mesh.triangles], image[mesh.triangles][:, flip]]),
        np.vstack([old[segments], image[segments][:, [1, 0, 2]]]),
        np.concatenate([names, far_names]),
        mesh.quarter_elements,
    )


def to_ngsolve(mesh: TriangleMesh) -> ng.Mesh:
    """An NGSolve mesh whose edges pass exactly through the middle nodes.

    Netgen's own curving would fit parabolas to a geometry; here the second-order geometry is given
    as the mesh's deformation, a piecewise quadratic field that is nonzero on curved edges.
    """
    flat = nm.Mesh(dim=2)
    corners = mesh.points[: mesh.vertices]
    flat.AddPoints(np.ascontiguousarray(np.column_stack([corners, np.zeros(len(corners))])))
    flat.Add(nm.FaceDescriptor(surfnr=1, domin=1, bc=1))
    flat.SetMaterial(1, "solid")
    flat.AddElements(2, 1, np.ascontiguousarray(mesh.triangles[:, :3], np.int32), 0)
    present = np.unique(mesh.names)
    for index, name in enumerate(present, 1):
        chosen = mesh.segments[mesh.names == name][:, :2]
        flat.AddElements(1, index, np.ascontiguousarray(chosen, np.int32), 0)
    for index, name in enumerate(present):
        flat.SetBCName(index, NAMES[name])
    result = ng.Mesh(flat)
    result.SetDeformation(_deformation(result, mesh))
    return result


def _deformation(flat: ng.Mesh, mesh: TriangleMesh) -> Any:
    n = mesh.vertices
    a, b, m = mesh.triangles[:, [0, 1, 2]], mesh.triangles[:, [1, 2, 0]], mesh.triangles[:, 3:]
    low, high, middle = (value.ravel() for value in (np.minimum(a, b), np.maximum(a, b), m))
    keys, first = np.unique(low * n + high, return_index=True)
    middle = middle[first]
    pairs = np.sort([[v.nr for v in edge.vertices] for edge in flat.edges], axis=1)
    place = np.searchsorted(keys, pairs[:, 0] * n + pairs[:, 1])
    bow = mesh.points[middle[place]] - mesh.points[pairs].mean(axis=1)
    space = ng.VectorH1(flat, order=2)
    scalar = ng.H1(flat, order=2)
    if scalar.ndof != n + len(pairs):
        raise AssertionError("NGSolve numbers the dofs of H1(order=2) in an unexpected way")
    unit = ng.GridFunction(scalar)
    element = next(iter(flat.Elements(ng.VOL)))
    unit.vec[n + element.edges[0].nr] = 1.0
    trafo = flat.GetTrafo(element)
    height = max((unit(trafo(*p)) for p in ((0.5, 0.5), (0.0, 0.5), (0.5, 0.0))), key=abs)
    deformation = ng.GridFunction(space, name="second-order geometry")
    values = deformation.vec.FV().NumPy()
    values[n : scalar.ndof] = bow[:, 0] / height
    values[scalar.ndof + n :] = bow[:, 1] / height
    return deformation
