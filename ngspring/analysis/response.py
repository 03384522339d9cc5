"""What a load-displacement analysis reached."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ngspring.analysis.path import Jump
from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.problem.spring import SpringProblem

if TYPE_CHECKING:
    from ngspring.fem.grid import Grid

_PER_POINT = ("d", "q", "energy", "stiffness", "grey", "u", "nodes_u")


@dataclass(frozen=True, eq=False)
class Response:
    """What a load-displacement analysis reached.

    Attributes
    ----------
    problem : SpringProblem
        With the domain that was analysed.
    d, q : arrays (points,)
        Displacements in mm, in the order they were asked for, without those that were not reached,
        and reaction forces in N.
    energy : array (points,)
        Strain energy in N mm; ``dE/dd = q``.
    stiffness : array (points,)
        dq/dd in N/mm, to about 1e-5 of it.
    grey : array (points,)
        Share of the strain energy where the density is between 0.1 and 0.9.
    u : array (points, 2, ndof)
        Displacement fields, dofs of the VectorH1 space of order 2 on the mesh of `grid`.
    nodes_u : array (points, 2, 2 nx + 1, 2 ny + 1)
        The same in mm at the vertices, edge middles and centres of the mesh (see `nodes_x`).
    complete : bool
        Whether every displacement that was asked for was reached.
    message : str
        Where and why the path ended, if it did.
    jumps : tuple of Jump
        Where a branch ended on the way and the spring snapped to another one.
    iterations : int
        Newton iterations in all.
    """

    problem: SpringProblem
    d: FloatArray
    q: FloatArray
    energy: FloatArray
    stiffness: FloatArray
    grey: FloatArray
    u: FloatArray
    nodes_u: FloatArray
    complete: bool
    message: str
    iterations: int
    jumps: tuple[Jump, ...] = ()

    def selected(self, places: Sequence[int] | IntArray) -> Response:
        """The same with these of its points only, in this order."""
        k = np.asarray(places, dtype=int)
        return dataclasses.replace(self, **{name: getattr(self, name)[k] for name in _PER_POINT})

    def by_displacement(self) -> Response:
        """The same in increasing order of d, each displacement once: a curve."""
        return self.selected(np.unique(self.d, return_index=True)[1])

    @property
    def grid(self) -> Grid:
        """The mesh the fields live on."""
        # NGSolve takes a while to import: what only draws a response does without.
        from ngspring.fem.grid import Grid

        return Grid(self.problem)

    @property
    def nodes_x(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates in mm of the places of `nodes_u`, from the lower left corner."""
        nx, ny = self.problem.sector.cells(self.problem.elements)
        width, height = self.problem.sector.size
        return np.linspace(0, width, 2 * nx + 1), np.linspace(0, height, 2 * ny + 1)


def response_csv(response: Response) -> str:
    """Comma-separated d, q, energy and stiffness; numbers round-trip exactly."""
    columns = (response.d, response.q, response.energy, response.stiffness)
    lines = ["d,q,energy,stiffness"]
    for row in zip(*columns, strict=True):
        lines.append(",".join(repr(float(value)) for value in row))
    return "\n".join(lines) + "\n"
