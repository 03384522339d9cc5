"""Load-displacement curve of a given design (forward analysis)."""

from __future__ import annotations

import logging
from collections.abc import Iterable

import ngsolve as ng
import numpy as np

from ngspring.analysis.mechanics import Equilibrium, Mechanics
from ngspring.analysis.path import Jump, both_ways, checked_displacements, follow, in_order
from ngspring.analysis.response import Response
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.process import parallel
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


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


def control_point_responses(
    design: Design,
    further: Iterable[float] = (),
    *,
    domain: str | None = None,
    threads: int | None = None,
) -> dict[float, Response]:
    """Responses at the control points by their offset eta.

    Parameters
    ----------
    design : Design
    further : iterable of float
        More displacements in mm for eta = 0, to draw a curve.
    domain : {"quarter", "full"}, optional
        Overrides the problem's.
    threads : int, optional
        See `ngspring.optimize`.
    """
    wanted: dict[float, set[float]] = {0.0: {0.0, *further}}
    for point in design.problem.control_points:
        if not point.on_curves:
            continue
        wanted.setdefault(point.eta, set()).add(point.d)
    return {
        eta: load_displacement(design, sorted(targets), domain, eta=eta, threads=threads)
        for eta, targets in wanted.items()
    }
