"""Each constraint of the paper as a linear subspace of a plain H1 space (2.5, 2.7)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.design.splines import fold_x, fold_y
from ngspring.fem.grid import ScalarSpace


def hierarchical_functionals(cells: int, fold: IntArray) -> sp.csr_matrix:
    """Coefficients -> hierarchical quadratic finite element dofs on a line.

    Row ``2 i`` is the value at vertex ``i``; row ``2 i + 1`` is the *bubble* of cell ``i``: the
    value in its middle minus the mean of its ends. Quadratic splines are piecewise quadratic, so
    these rows reproduce them exactly.
    """
    vertex = np.arange(cells + 1)
    cell = np.arange(cells)
    rows = np.concatenate([2 * vertex, 2 * vertex] + [2 * cell + 1] * 3)
    splines = np.concatenate([vertex, vertex + 1, cell, cell + 1, cell + 2])
    weights = np.concatenate(
        [np.full(2 * (cells + 1), 0.5)] + [np.full(cells, w) for w in (-0.125, 0.25, -0.125)]
    )
    shape = (2 * cells + 1, int(fold.max()) + 1)
    return sp.csr_matrix((weights, (rows, fold[splines])), shape=shape)


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
    if not grid.sector.half_height:
        parent[top] = scalar.opposite(top, 1)
    u_lx = int(left[scalar.is_vertex(left)][0])
    tie(left, u_lx, 1.0)
    if grid.sector.half_width:
        weight[right] = 0.0
    else:
        tie(right, u_lx, -1.0)
        parent[n + right] = n + scalar.opposite(right, 0)
    u_ty = n + int(top[scalar.is_vertex(top)][0])
    weight[n + bottom] = 0.0
    tie(n + top, u_ty, grid.sector.share)

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
