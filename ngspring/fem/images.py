"""What a control point analyses of its spring: one copy, or two that lie beside each other.

A doubly symmetric state is one quarter. With an imperfection that is odd in x, in y or in both the
state has only half of the symmetries: two copies of the quarter, ``v`` and ``v'``, which a mirror
line that is broken joins. ``v`` is the quarter itself, and ``v'`` its neighbour, mirrored back onto
it, so that both live on one mesh, chi + eta_odd f on one and chi - eta_odd f on the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.constraints import displacement_extraction
from ngspring.fem.grid import ScalarSpace
from ngspring.problem.imperfection import Offset

_AXES = {"x": 0, "y": 1}


@dataclass(frozen=True, eq=False)
class Image:
    """One of the copies.

    Attributes
    ----------
    matrix : scipy.sparse.csr_matrix (2 ndof, free + 1)
        Dofs of the VectorH1 space <- independent displacements of all copies; the last column is
        u_Ty.
    sign : float
        Of the odd pattern.
    share : float
        Part of the analysed measure that this copy stands for.
    """

    matrix: sp.csr_matrix
    sign: float
    share: float

    @cached_property
    def transposed(self) -> sp.csr_matrix:
        """Transpose of `matrix`."""
        return self.matrix.T.tocsr()


@dataclass(frozen=True, eq=False)
class Images:
    """All copies that a control point analyses.

    Attributes
    ----------
    copies : tuple of Image
    own : int array (free,)
        A dof whose value each independent displacement is, of all copies' dofs in a row.
    """

    copies: tuple[Image, ...]
    own: IntArray

    @property
    def free(self) -> int:
        """Number of independent displacements without u_Ty."""
        return len(self.own)

    def fields(self, u: FloatArray) -> list[FloatArray]:
        """Dofs of the VectorH1 space of each copy from the independent displacements, u_Ty last."""
        return [np.asarray(copy.matrix @ u) for copy in self.copies]

    def offsets(self, offset: Offset) -> list[Offset]:
        """The offset of chi as each copy has it."""
        return [offset.mirrored(copy.sign) for copy in self.copies]

    def reduced(self, forces: Iterable[FloatArray]) -> FloatArray:
        """Forces on the dofs of every copy as forces on the independent displacements and u_Ty."""
        each = zip(self.copies, forces, strict=True)
        shares = [copy.share * (copy.transposed @ force) for copy, force in each]
        return np.asarray(np.sum(shares, axis=0))

    def restrict(self, field: FloatArray) -> FloatArray:
        """Independent displacements (without u_Ty) of a field that is the same in all copies."""
        return np.asarray(np.tile(field, len(self.copies))[self.own])


def images(scalar: ScalarSpace, odd_in: str = "") -> Images:
    """The copies for an imperfection that is odd in these axes; in none by default.

    Where a symmetry is not used anyway (in the full domain), breaking it takes no second copy.
    """
    used = {mirror.axis for mirror in scalar.grid.sector.mirrors if not mirror.rotation}
    broken = {_AXES[axis] for axis in odd_in} & used
    if broken:
        return _twins(scalar, broken)
    extraction = displacement_extraction(scalar)
    rows = np.flatnonzero((extraction.weight == 1.0) & (extraction.master < extraction.free))
    own = np.empty(extraction.free, dtype=np.int64)
    own[extraction.master[rows]] = rows
    return Images((Image(extraction.matrix, 1.0, 1.0),), own)


class _Ties:
    """Values ``weight v[parent] + top u_Ty`` of the dofs of both copies, in a row."""

    def __init__(self, ndof: int) -> None:
        self.parent = np.arange(4 * ndof)
        self.weight = np.ones(4 * ndof)
        self.top = np.zeros(4 * ndof)

    def fix(self, dofs: IntArray, top: FloatArray | float = 0.0) -> None:
        """A multiple of u_Ty, or zero."""
        self.weight[dofs] = 0.0
        self.top[dofs] = top

    def tie(self, dofs: IntArray, to: IntArray, sign: float = 1.0) -> None:
        """As other dofs are (which do not depend on u_Ty), but for a sign."""
        self.parent[dofs] = self.parent[to]
        self.weight[dofs] = sign * self.weight[to]

    def images(self) -> Images:
        """The copies, each half of the whole."""
        size = len(self.parent)
        used = np.flatnonzero(self.weight)
        own = np.unique(self.parent[used])
        number = np.full(size, -1)
        number[own] = np.arange(len(own))
        topped = np.flatnonzero(self.top)
        rows = np.concatenate([used, topped])
        columns = np.concatenate([number[self.parent[used]], np.full(len(topped), len(own))])
        values = np.concatenate([self.weight[used], self.top[topped]])
        whole = sp.csr_matrix((values, (rows, columns)), shape=(size, len(own) + 1))
        half = size // 2
        copies = Image(whole[:half], 1.0, 0.5), Image(whole[half:], -1.0, 0.5)
        return Images(copies, own.astype(np.int64))


def _twins(scalar: ScalarSpace, broken: set[int]) -> Images:
    """Boundary conditions of 2.5 on two quarters that meet at the broken mirror lines.

    With ``v'(x, y) = (-u_x(L - x, y), u_y(L - x, y))`` (odd in x, or in both) or
    ``(u_x(x, H - y), d - u_y(x, H - y))`` (in y). Where they meet u is continuous, on the left
    and the bottom it is periodic as 2.5 demands.
    """
    n = scalar.ndof
    ties = _Ties(n)
    left, right, bottom, top = (scalar.on(side) for side in ("left", "right", "bottom", "top"))
    x, y, other = 0, n, 2 * n
    u_lx = left[scalar.is_vertex(left)][:1]
    for copy in (0, other):
        vertex = scalar.is_vertex(left)
        ties.fix(copy + x + left[~vertex])
        ties.tie(copy + x + left[vertex], np.broadcast_to(u_lx, vertex.sum()))
        ties.fix(copy + y + bottom)
        if 0 not in broken:
            ties.fix(copy + x + right)
        if 1 not in broken:
            ties.fix(copy + y + top, np.where(scalar.is_vertex(top), 0.5, 0.0))
    if 0 in broken:
        ties.tie(other + y + left, y + left)
        ties.tie(other + x + right, x + right, -1.0)
        ties.tie(other + y + right, y + right)
    if 1 in broken:
        ties.tie(other + x + bottom, x + bottom)
        ties.tie(other + x + top, x + top)
        ties.tie(other + y + top, y + top, -1.0)
        ties.top[other + y + top] = np.where(scalar.is_vertex(top), 1.0, 0.0)
    if 0 in broken and 1 not in broken:
        for copy in (0, other):
            ties.fix(copy + y + top, np.where(scalar.is_vertex(top), 0.5, 0.0))
    if broken == {0, 1}:
        # Where both lines meet, or a line meets a periodic side, the two conditions leave nothing.
        for copy in (0, other):
            ties.fix(copy + x + np.intersect1d(right, np.concatenate([top, bottom])))
            ties.fix(copy + y + np.intersect1d(top, np.concatenate([left, right])), 0.5)
    return ties.images()
