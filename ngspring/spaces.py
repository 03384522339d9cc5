"""Meshes and finite element spaces, each constraint of the paper as a linear subspace (2.5, 2.7).

All fields live in plain NGSolve H1 spaces of order 2 on a structured mesh of quadrilaterals.
What the paper restricts (splines for chi; tied, opposite, periodic and fixed displacements) is a
sparse *extraction matrix* from the independent unknowns to the dofs of the H1 space, exact to
rounding. Design notes: the quarter and the full domain are the same problem for a doubly
symmetric design as long as its deformation stays symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from ngsolve.meshes import MakeStructured2DMesh
from numpy.typing import NDArray

from ngspring.problem import SpringProblem
from ngspring.splines import FloatArray, IntArray, fold_x, fold_y, hierarchical_functionals


@dataclass(frozen=True)
class Grid:
    """The analysed part of the domain as a structured grid.

    The quarter is the lower left one, ``[0, L/2] x [0, H/2]``. In the axisymmetric case only the
    half left of the axis is meshed (``r = L/2 - x``), so "full" is ``[0, L/2] x [0, H]``.
    """

    problem: SpringProblem

    @property
    def half_width(self) -> bool:
        """Whether the mesh ends at the middle, x = L/2."""
        return self.problem.quarter or self.problem.axisymmetric

    @property
    def half_height(self) -> bool:
        """Whether the mesh ends at the middle, y = H/2."""
        return self.problem.quarter

    @property
    def cells(self) -> tuple[int, int]:
        """Number of elements in x and in y."""
        n = self.problem.elements
        return (n // 2 if self.half_width else n, n // 2 if self.half_height else n)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the meshed part in mm."""
        problem = self.problem
        return (
            problem.L / 2 if self.half_width else problem.L,
            problem.H / 2 if self.half_height else problem.H,
        )

    @property
    def copies(self) -> int:
        """How many times the meshed part stands in the whole (the axis counts as one)."""
        copies = 2 if self.half_height else 1
        return copies if self.problem.axisymmetric else copies * (2 if self.half_width else 1)

    @cached_property
    def mesh(self) -> ng.Mesh:
        """The structured mesh of quadrilaterals."""
        width, height = self.size
        nx, ny = self.cells
        return MakeStructured2DMesh(
            quads=True, nx=nx, ny=ny, mapping=lambda x, y: (width * x, height * y)
        )


class ScalarSpace:
    """H1 of order 2 with the place of every dof on the grid.

    Attributes
    ----------
    space : ngsolve.H1
    node : int array (ndof, 2)
        Place of each dof in half cells: even numbers are vertex lines, odd ones cell middles, so
        (even, even) is a vertex dof, (odd, odd) a cell bubble and the others edge bubbles.
    bubble_value : float array (ndof,)
        Value of the basis function at its own node (1 for vertices): NGSolve's bubbles are not
        normalised to one.
    """

    def __init__(self, grid: Grid) -> None:
        mesh = grid.mesh
        self.grid = grid
        self.space = ng.H1(mesh, order=2)
        nx, ny = grid.cells
        width, height = grid.size
        points = np.array([mesh[v].point for v in mesh.vertices])
        vertex = np.rint(points / [width / (2 * nx), height / (2 * ny)]).astype(np.int64)
        edges = np.array([[v.nr for v in mesh[e].vertices] for e in mesh.edges])
        faces = np.array([[v.nr for v in mesh[f].vertices] for f in mesh.faces])
        self.node: IntArray = np.concatenate(
            [vertex, vertex[edges].sum(axis=1) // 2, vertex[faces].sum(axis=1) // 4]
        )
        if len(self.node) != self.space.ndof:
            raise AssertionError("NGSolve numbers the dofs of H1(order=2) in an unexpected way")
        self.bubble_value = np.ones(self.space.ndof)
        nv, ne = len(vertex), len(edges)
        for first, last in ((nv, nv + ne), (nv + ne, self.space.ndof)):
            # Every bubble of one kind has the same height: one evaluation of each is enough.
            unit = ng.GridFunction(self.space)
            unit.vec[first] = 1.0
            i, j = self.node[first]
            value = unit(mesh(width * i / (2 * nx), height * j / (2 * ny)))
            self.bubble_value[first:last] = value

    @property
    def ndof(self) -> int:
        """Number of dofs."""
        return int(self.space.ndof)

    def on(self, side: str) -> IntArray:
        """Dofs on a side of the grid: "left", "right", "bottom" or "top"."""
        axis = 0 if side in ("left", "right") else 1
        place = 0 if side in ("left", "bottom") else 2 * self.grid.cells[axis]
        return np.flatnonzero(self.node[:, axis] == place)

    def is_vertex(self, dofs: IntArray) -> NDArray[np.bool_]:
        """Which of these dofs are vertex dofs."""
        return np.asarray((self.node[dofs] % 2 == 0).all(axis=1))

    def opposite(self, dofs: IntArray, axis: int) -> IntArray:
        """The dofs at the same place of the opposite side."""
        ny = 2 * self.grid.cells[1] + 1
        key = self.node[:, 0] * ny + self.node[:, 1]
        order = np.argsort(key)
        moved = self.node[dofs].copy()
        moved[:, axis] = 2 * self.grid.cells[axis] - moved[:, axis]
        return np.asarray(order[np.searchsorted(key[order], moved[:, 0] * ny + moved[:, 1])])


def spline_extraction(scalar: ScalarSpace) -> sp.csr_matrix:
    """Extraction matrix of chi: H1 dofs <- independent spline coefficients.

    Columns are the coefficients of shape ``problem.coefficient_shape`` in C order. Rows are exact:
    a quadratic spline on the grid is an element of the Q2 space.
    """
    grid = scalar.grid
    n = grid.problem.elements
    along_x = hierarchical_functionals(grid.cells[0], fold_x(n))
    along_y = hierarchical_functionals(grid.cells[1], fold_y(n))
    rows = scalar.node[:, 0] * (2 * grid.cells[1] + 1) + scalar.node[:, 1]
    extraction = sp.kron(along_x, along_y, format="csr")[rows]
    return sp.csr_matrix(sp.diags_array(1.0 / scalar.bubble_value) @ extraction)


@dataclass(frozen=True)
class DisplacementExtraction:
    """Dofs of the VectorH1 space <- independent displacements, and the one of the top side.

    Attributes
    ----------
    master, weight : arrays (2 * ndof of the scalar space,)
        Full dof ``i`` equals ``weight[i] * v[master[i]]``; a removed dof has weight 0. At most
        one master per dof: all constraints of 2.5 are of this kind in a hierarchical basis.
    free : int
        Number of independent displacements. Master ``free`` (one more) is ``u_Ty``, the vertical
        displacement of the top side, which is prescribed.
    """

    master: IntArray
    weight: FloatArray
    free: int

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """The same as a sparse matrix of shape (2 ndof, free + 1); the last column is u_Ty."""
        rows = np.flatnonzero(self.weight)
        shape = (len(self.master), self.free + 1)
        return sp.csr_matrix((self.weight[rows], (rows, self.master[rows])), shape=shape)

    def restrict(self, full: FloatArray) -> FloatArray:
        """Independent displacements of a field that satisfies the constraints (u_Ty is last)."""
        used = np.flatnonzero(self.weight)
        result = np.zeros(self.free + 1)
        result[self.master[used]] = full[used] / self.weight[used]
        return result


def displacement_extraction(scalar: ScalarSpace) -> DisplacementExtraction:
    """Boundary conditions of 2.5 (full domain), or their symmetric half (quarter).

    Full domain: u_x is one value u_Lx on the left side and -u_Lx on the right one (0 on the axis);
    u_y is 0 on the bottom and one value u_Ty on the top; u_x on the top equals u_x on the bottom,
    u_y on the right equals u_y on the left. Quarter: u_Lx on the left, u_x = 0 and u_y = u_Ty / 2
    on the mirror lines, u_y = 0 on the bottom.
    """
    grid = scalar.grid
    n = scalar.ndof
    parent = np.arange(2 * n)
    weight = np.ones(2 * n)

    def tie(dofs: IntArray, to: int, factor: float) -> None:
        """One common value: the bubbles of a constant are zero."""
        vertex = scalar.is_vertex(dofs % n)
        parent[dofs[vertex]] = to
        weight[dofs[vertex]] = factor
        weight[dofs[~vertex]] = 0.0

    left, right = scalar.on("left"), scalar.on("right")
    bottom, top = scalar.on("bottom"), scalar.on("top")
    if not grid.half_height:
        parent[top] = scalar.opposite(top, 1)
    u_lx = int(left[scalar.is_vertex(left)][0])
    tie(left, u_lx, 1.0)
    if grid.half_width:
        weight[right] = 0.0
    else:
        tie(right, u_lx, -1.0)
        parent[n + right] = n + scalar.opposite(right, 0)
    u_ty = n + int(top[scalar.is_vertex(top)][0])
    weight[n + bottom] = 0.0
    tie(n + top, u_ty, 0.5 if grid.half_height else 1.0)

    used = weight != 0.0
    is_master = np.zeros(2 * n, bool)
    is_master[parent[used]] = True
    is_master[u_ty] = False
    number = np.full(2 * n, -1)
    number[is_master] = np.arange(is_master.sum())
    free = int(is_master.sum())
    number[u_ty] = free
    master = np.where(used, number[parent], 0)
    return DisplacementExtraction(master.astype(np.int64), weight, free)


def stretched(scalar: ScalarSpace) -> FloatArray:
    """Dofs of the VectorH1 space for a uniform vertical stretch, u = (0, y / H): d = 1 mm."""
    grid = scalar.grid
    u_y = scalar.node[:, 1] * (grid.problem.h_y / 2 / grid.problem.H)
    u_y[~scalar.is_vertex(np.arange(scalar.ndof))] = 0.0
    return np.concatenate([np.zeros(scalar.ndof), u_y])
