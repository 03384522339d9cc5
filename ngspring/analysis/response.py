"""Load-displacement curve of a given design (forward analysis)."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from ngspring.analysis.mechanics import Equilibrium, Mechanics
from ngspring.analysis.path import Jump, both_ways, checked_displacements, follow, in_order
from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.process import parallel
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


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
        return Grid(self.problem)

    @property
    def nodes_x(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates in mm of the places of `nodes_u`, from the lower left corner."""
        nx, ny = self.grid.cells
        width, height = self.grid.size
        return np.linspace(0, width, 2 * nx + 1), np.linspace(0, height, 2 * ny + 1)


def nodal_values(scalar: ScalarSpace, dofs: FloatArray) -> FloatArray:
    """Values at vertices, edge middles and centres, (2 nx + 1, 2 ny + 1), from the dofs."""
    nx, ny = scalar.grid.cells
    values = np.zeros((2 * nx + 1, 2 * ny + 1))
    values[scalar.node[:, 0], scalar.node[:, 1]] = dofs * scalar.bubble_value
    # Hierarchical basis: an inner node adds its bubble to the mean of its neighbours.
    values[1::2, ::2] += (values[:-1:2, ::2] + values[2::2, ::2]) / 2
    values[::2, 1::2] += (values[::2, :-1:2] + values[::2, 2::2]) / 2
    corners = values[:-1:2, :-1:2] + values[2::2, :-1:2] + values[:-1:2, 2::2] + values[2::2, 2::2]
    in_x = values[1::2, :-1:2] + values[1::2, 2::2]
    in_y = values[:-1:2, 1::2] + values[2::2, 1::2]
    values[1::2, 1::2] += in_x / 2 + in_y / 2 - corners / 4
    return values


def load_displacement(
    design: Design | ng.CoefficientFunction,
    displacements: Iterable[float],
    domain: str | None = None,
    *,
    problem: SpringProblem | None = None,
    eta: float = 0.0,
    threads: int | None = None,
    solver: str = "auto",
) -> Response:
    """Equilibrium of a design at prescribed displacements.

    The path is followed from the undeformed state in both directions with adaptive steps; where
    it cannot be followed any further, what was reached is returned with a message.

    Parameters
    ----------
    design : Design or ngsolve.CoefficientFunction
        A formula in ``ngsolve.x``, ``ngsolve.y`` (mm from the lower left corner of the full
        domain) is evaluated at the Gauss points and needs ``problem``.
    displacements : iterable of float
        Displacements d in mm, in any order, which is that of the results; 0 is allowed.
    domain : {"quarter", "full"}, optional
        Overrides the problem's.
    problem : SpringProblem, optional
        For a formula; otherwise the design's own.
    eta : float
        Offset of chi: dilation or erosion (2.6).
    threads, solver
        See `ngspring.optimize`.

    Returns
    -------
    Response

    Raises
    ------
    ProblemError
        If a displacement is not a finite number smaller than H in size, eta is not finite, or a
        formula comes without a problem.
    """
    if isinstance(design, Design):
        problem = design.problem if problem is None else problem
    elif not isinstance(design, ng.CoefficientFunction):
        raise ProblemError(f"design = {design!r} is neither a Design nor a CoefficientFunction")
    if problem is None:
        raise ProblemError("a design given as a formula needs problem = SpringProblem(...)")
    if not np.isfinite(eta):
        raise ProblemError(f"eta = {eta!r} must be a finite number")
    if domain is not None:
        problem = problem.replace(domain=domain)
    targets = checked_displacements(displacements, problem)
    with parallel(threads, problem) as count:
        scalar = ScalarSpace(Grid(problem))
        chi: ng.CoefficientFunction | FloatArray = design
        if isinstance(design, Design):
            coefficients = design.with_problem(problem).coefficients
            chi = spline_extraction(scalar) @ coefficients.ravel()
        mechanics = Mechanics(scalar, chi, eta, solver, count)
        rest = mechanics.at_rest()
        points: list[Equilibrium] = [rest]
        messages: list[str] = []
        jumps: list[Jump] = []
        iterations = [0]

        def count_iterations(point: Equilibrium) -> None:
            iterations[0] += point.iterations + 1
            logger.info(
                "d = %.6g mm: q = %.8g N, %d iterations", point.d, point.q, point.iterations
            )

        for side in both_ways(targets):
            reached, message = follow(
                mechanics, side, rest, on_point=count_iterations, on_jump=jumps.append
            )
            points += reached
            if message:
                logger.warning(message)
                messages.append(message)
        points = in_order(targets, points)
        fields = [mechanics.full_field(point.d, point.u) for point in points]
        energies = [mechanics.energy(point.d, point.u) for point in points]
        grey = [mechanics.grey_share(point.d, point.u) for point in points]
    n = scalar.ndof
    nodes = [[nodal_values(scalar, f[:n]), nodal_values(scalar, f[n:])] for f in fields]
    nx, ny = scalar.grid.cells
    return Response(
        problem=problem,
        d=np.array([point.d for point in points]),
        q=np.array([point.q for point in points]),
        energy=np.array(energies),
        stiffness=np.array([point.stiffness for point in points]),
        grey=np.array(grey),
        u=np.array(fields).reshape(-1, 2, n),
        nodes_u=np.array(nodes).reshape(-1, 2, 2 * nx + 1, 2 * ny + 1),
        complete=not messages,
        message="; ".join(messages),
        jumps=tuple(jumps),
        iterations=iterations[0],
    )


def response_csv(response: Response) -> str:
    """Comma-separated d, q, energy and stiffness; numbers round-trip exactly."""
    columns = (response.d, response.q, response.energy, response.stiffness)
    lines = ["d,q,energy,stiffness"]
    for row in zip(*columns, strict=True):
        lines.append(",".join(repr(float(value)) for value in row))
    return "\n".join(lines) + "\n"
