"""Steps in which no wall jumps through another: continuous collision detection of a skeleton.

Contact as an energy of the gap (`ngspring.solid.contact.contact`) sees surfaces that overlap a
little; a long Newton step could carry a wall right through another one, to where nothing pushes it
back. So each step is limited to what keeps a skeleton of the solid free of intersections: polygons
of material points that follow the surface at about a seventh of an element's height inside. That is
the continuous collision detection of the IPC Toolkit (Li et al., "Incremental Potential Contact",
ACM Transactions on Graphics 39 (2020) 49, doi:10.1145/3386569.3392425; `ipctk`), but not its
barrier: the skeletons of two surfaces in contact stay clear of each other.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ProblemError

_DEPTH = 0.15
#: Not too near the ends: in the corner of a triangle with two free edges polygons would cross.
_ALONG = np.array([0.2, 0.5, 0.8])


class Skeleton:
    """Polygons of material points just inside the surface of a solid.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Second-order triangles.
    name : str
        Name of the surface's boundary pieces.
    unit : float
        Length in mm in which the IPC Toolkit, whose tolerances are absolute, sees the points.

    Raises
    ------
    ProblemError
        If ipctk is not installed, or the polygons intersect at rest.
    """

    def __init__(self, mesh: Any, name: str, unit: float = 1.0) -> None:
        try:
            import ipctk
        except ImportError:
            raise ProblemError(
                "contact analysis needs the IPC Toolkit: pip install ipctk"
            ) from None
        self._ipctk = ipctk
        matrix, rest, ends = _inner_points(mesh, name)
        self.matrix, self.rest = matrix / unit, rest / unit
        count = len(_ALONG)
        first = count * np.arange(len(ends))
        inside = [np.stack([first + k, first + k + 1], axis=1) for k in range(count - 1)]
        links = _links(ends, first, first + count - 1)
        polygons = np.concatenate([*inside, links]).astype(np.int32)
        rest = np.asfortranarray(self.rest)
        self._mesh = ipctk.CollisionMesh(rest, np.asfortranarray(polygons))
        if ipctk.has_intersections(self._mesh, rest):
            raise ProblemError(
                "polygons just inside the surface intersect: the mesh is too coarse for its shape,"
                " or surfaces were moved into each other"
            )

    def positions(self, full: FloatArray) -> FloatArray:
        """Deformed points (points, 2) in units from the dofs of the VectorH1 space."""
        n = self.matrix.shape[1]
        moved = np.stack([self.matrix @ full[:n], self.matrix @ full[n:]], axis=1)
        return np.asfortranarray(self.rest + moved)

    def largest_step(self, begin: FloatArray, end: FloatArray) -> float:
        """Which part of the way from `begin` to `end` (dofs) is free; 1 for all of it."""
        x, y = self.positions(begin), self.positions(end)
        if not np.isfinite(y).all():
            return 0.0
        return float(self._ipctk.compute_collision_free_stepsize(self._mesh, x, y))

    def intersects(self, full: FloatArray) -> bool:
        """Whether polygons intersect at these dofs."""
        return bool(self._ipctk.has_intersections(self._mesh, self.positions(full)))


def _inner_points(mesh: Any, name: str) -> tuple[sp.csr_matrix, FloatArray, IntArray]:
    """Matrix (points, ndof), rest positions, and the end vertices of each edge in order."""
    space = ng.H1(mesh, order=2)
    element_of = {edge.nr: element for element in mesh.Elements(ng.VOL) for edge in element.edges}
    pieces = [e for e in mesh.Elements(ng.BND) if e.mat == name]
    rule = ng.IntegrationRule([(0.5,)], [1.0])
    on_edges = mesh.MapToAllElements(rule, ng.BND)
    middles = np.asarray(ng.CF((ng.x, ng.y))(on_edges)).reshape(-1, 2)
    unit = ng.GridFunction(space)
    unit.vec[int(mesh.nv + pieces[0].edges[0].nr)] = 1.0
    # The middle of an edge has the value `bubble` and the product of its barycentrics is 1/4.
    bubble = 4 * float(np.asarray(unit(on_edges)).ravel()[pieces[0].nr])
    vertices = np.array([v.point for v in mesh.vertices])
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    rest: list[FloatArray] = []
    ends: list[tuple[int, int]] = []
    for piece in pieces:
        edge = piece.edges[0].nr
        element = element_of[edge]
        a, b = (v.nr for v in piece.vertices)
        (apex,) = (v.nr for v in element.vertices if v.nr not in (a, b))
        bulge = middles[piece.nr] - (vertices[a] + vertices[b]) / 2
        for s in _ALONG:
            lam = {a: (1 - s) * (1 - _DEPTH), b: s * (1 - _DEPTH), apex: _DEPTH}
            row = len(rest)
            straight = np.array(list(lam.values())) @ vertices[list(lam)]
            rest.append(straight + 4 * lam[a] * lam[b] * bulge)
            for v, value in lam.items():
                rows.append(row)
                columns.append(v)
                values.append(value)
            for other in element.edges:
                p, q = (v.nr for v in mesh[other].vertices)
                rows.append(row)
                columns.append(mesh.nv + other.nr)
                values.append(bubble * lam[p] * lam[q])
        ends.append((a, b))
    shape = (len(rest), space.ndof)
    return sp.csr_matrix((values, (rows, columns)), shape=shape), np.array(rest), np.array(ends)


def _links(ends: IntArray, first: IntArray, last: IntArray) -> IntArray:
    """Segments between the polygons of edges that share a vertex."""
    points = np.concatenate([first, last])
    vertices = np.concatenate([ends[:, 0], ends[:, 1]])
    order = np.argsort(vertices, kind="stable")
    same = vertices[order[:-1]] == vertices[order[1:]]
    return np.stack([points[order[:-1]][same], points[order[1:]][same]], axis=1)
