"""The free surface of a solid as quadratic curves, moved by the displacement dofs.

Each boundary edge of a second-order mesh is a parabola through three nodes, its ends and its
middle, before and after deformation: ``x(s) = sum_i N_i(s) x_i`` with ``0 <= s <= 1``. The nodes
are a fixed sparse matrix times the dofs (NGSolve's basis is hierarchical: a middle is the mean of
the ends plus a multiple of the edge's dof), so everything that follows is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ProblemError


def shapes(s: FloatArray) -> FloatArray:
    """N_i(s) of the first end, the middle and the second end; shape (..., 3)."""
    return np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)], axis=-1)


def slopes(s: FloatArray) -> FloatArray:
    """Derivatives of `shapes` by s."""
    return np.stack([4 * s - 3, 4 - 8 * s, 4 * s - 1], axis=-1)


#: Second derivatives of `shapes`.
CURVATURES = np.array([4.0, -8.0, 4.0])


def outward(tangent: FloatArray) -> FloatArray:
    """A right angle clockwise: outward, for edges that have the solid on their left."""
    return np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)


@dataclass(frozen=True, eq=False)
class Surface:
    """Curved edges of the free surface.

    Attributes
    ----------
    nodes : int array (edges, 3)
        First end, middle and second end of each edge, with the solid on the left.
    rest : array (nodes, 2)
        Undeformed nodes in mm.
    matrix : sparse (nodes, ndof)
        One component of the nodes' displacements <- that component's dofs.
    open_ends : bool array (edges, 2)
        Whether the surface ends there, at a side of the meshed part.
    """

    nodes: IntArray
    rest: FloatArray
    matrix: sp.csr_matrix
    open_ends: NDArray[np.bool_]

    @property
    def edges(self) -> int:
        """Number of edges."""
        return len(self.nodes)

    def positions(self, full: FloatArray) -> FloatArray:
        """Deformed nodes (nodes, 2) in mm, from the dofs of the VectorH1 space."""
        n = self.matrix.shape[1]
        moved = np.stack([self.matrix @ full[:n], self.matrix @ full[n:]], axis=1)
        return np.asarray(self.rest + moved)

    def at(self, positions: FloatArray, s: FloatArray) -> FloatArray:
        """Points (edges, len(s), 2) at parameters s of every edge."""
        return np.asarray(np.einsum("si,eic->esc", shapes(s), positions[self.nodes]))

    def slopes_at(self, positions: FloatArray, s: FloatArray) -> FloatArray:
        """dx/ds (edges, len(s), 2)."""
        return np.asarray(np.einsum("si,eic->esc", slopes(s), positions[self.nodes]))


def free_surface(mesh: Any, name: str) -> Surface:
    """The boundary pieces of this name.

    Raises
    ------
    ProblemError
        If there are none.
    """
    elements = [e for e in mesh.Elements(ng.BND) if e.mat == name]
    if not elements:
        raise ProblemError(f"the mesh has no boundary named {name!r}")
    numbers = np.array([e.nr for e in elements])
    ends = np.array([[v.nr for v in e.vertices] for e in elements])
    edge = np.array([e.edges[0].nr for e in elements])
    rule = ng.IntegrationRule([(0.0,), (0.5,), (1.0,)], [1.0] * 3)
    points = mesh.MapToAllElements(rule, ng.BND)
    places = np.asarray(ng.CF((ng.x, ng.y))(points)).reshape(-1, 3, 2)[numbers]
    normal = np.asarray(ng.specialcf.normal(2)(points)).reshape(-1, 3, 2)[numbers, 1]
    vertices = np.array([v.point for v in mesh.vertices])
    # NGSolve runs through a segment from its second vertex to its first; do not rely on it.
    swapped = np.linalg.norm(vertices[ends[:, 0]] - places[:, 0], axis=1) > np.linalg.norm(
        vertices[ends[:, 0]] - places[:, 2], axis=1
    )
    ends[swapped] = ends[swapped][:, ::-1]
    turned = np.einsum("ec,ec->e", outward(places[:, 2] - places[:, 0]), normal) < 0.0
    ends[turned] = ends[turned][:, ::-1]

    used, local = np.unique(ends, return_inverse=True)
    local = local.reshape(ends.shape)
    count, m = len(used), len(ends)
    middle = count + np.arange(m)
    rest = np.concatenate([vertices[used], places[:, 1]])
    space = ng.H1(mesh, order=2)
    unit = ng.GridFunction(space)
    unit.vec[int(mesh.nv + edge[0])] = 1.0
    bubble = float(np.asarray(unit(points)).reshape(-1, 3)[numbers[0], 1])
    rows = np.concatenate([np.arange(count), middle, middle, middle])
    columns = np.concatenate([used, ends[:, 0], ends[:, 1], mesh.nv + edge])
    values = np.concatenate([np.ones(count), np.full(2 * m, 0.5), np.full(m, bubble)])
    matrix = sp.csr_matrix((values, (rows, columns)), shape=(count + m, space.ndof))
    nodes = np.stack([local[:, 0], middle, local[:, 1]], axis=1)
    single = np.bincount(local.ravel(), minlength=count) == 1
    return Surface(nodes, rest, matrix, single[local])
