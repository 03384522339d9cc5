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
from ngsolve.meshes import MakeStructured2DMesh
from numpy.typing import NDArray

from ngspring.basics.arrays import IntArray
from ngspring.problem.sector import Sector
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True)
class Grid:
    """The analysed part of the domain as a structured grid.

    The quarter is the lower left one, ``[0, L/2] x [0, H/2]``. In the axisymmetric case only the
    half left of the axis is meshed (``r = L/2 - x``), so "full" is ``[0, L/2] x [0, H]``.
    """

    problem: SpringProblem

    @property
    def sector(self) -> Sector:
        """The analysed part of the spring, and its mirror images."""
        return self.problem.sector

    @property
    def cells(self) -> tuple[int, int]:
        """Number of elements in x and in y."""
        return self.sector.cells(self.problem.elements)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the meshed part in mm."""
        return self.sector.size

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
