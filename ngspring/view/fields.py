"""A design and its deformed states as NGSolve grid functions, for NGSolve's own `Draw`."""

from __future__ import annotations

from typing import Any

import ngsolve as ng

from ngspring.analysis.response import Response
from ngspring.analysis.states import index_of
from ngspring.basics.errors import NgspringError
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace


def design_fields(
    design: Design, response: Response | None = None, d: float = 0.0
) -> tuple[Any, Any, Any]:
    """chi and u of a design at a displacement, as NGSolve grid functions.

    Parameters
    ----------
    design : Design
    response : Response, optional
        Of this design; only the undeformed state is known without it.
    d : float
        A displacement in mm that the response reached, or zero.

    Returns
    -------
    mesh : ngsolve.Mesh
        Of the analysed part of the spring.
    chi : ngsolve.GridFunction
        The design field, exactly; its density is ``ngspring.physics.energies.rho(chi)``.
    u : ngsolve.GridFunction
        Displacement in mm, (u_x, u_y); zero for the undeformed state.

    Raises
    ------
    NgspringError
        If the state is not in the response, or the response is on another mesh.

    Examples
    --------
    In a notebook::

        mesh, chi, u = design_fields(design, response, -20.0)
        Draw(rho(chi), mesh, deformation=u)
    """
    problem = design.problem
    index = None
    if response is not None:
        problem = problem.replace(domain=response.problem.domain)
        if response.problem.elements != problem.elements:
            raise NgspringError(
                f"the response is on {response.problem.elements} x {response.problem.elements}"
                f" elements, the design on {problem.elements} x {problem.elements}"
            )
        index = index_of(response, d)
    if index is None and d != 0.0:
        raise NgspringError(f"the response has no state at d = {d:g} mm")
    scalar = ScalarSpace(Grid(problem))
    mesh = scalar.grid.mesh
    chi = ng.GridFunction(scalar.space, name="chi")
    chi.vec.FV().NumPy()[:] = spline_extraction(scalar) @ design.coefficients.ravel()
    u = ng.GridFunction(ng.VectorH1(mesh, order=2), name="u")
    u.vec[:] = 0.0
    if response is not None and index is not None:
        u.vec.FV().NumPy()[:] = response.u[index].ravel()
    return mesh, chi, u
