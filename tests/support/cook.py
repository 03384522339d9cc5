"""Cook's membrane: a tapered panel in plane strain, clamped on the left, sheared on the right."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from netgen.geom2d import SplineGeometry
from scipy.sparse.linalg import spsolve

from ngspring.basics.arrays import FloatArray
from ngspring.physics.elasticity import Gradient, strain_energy
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.elasticity import Density, Solid, numbered
from ngspring.solid.contact.pressure import excess_of


def _mesh(maxh: float) -> Any:
    geometry = SplineGeometry()
    corners = [geometry.AppendPoint(*p) for p in ((0, 0), (48, 44), (48, 60), (0, 44))]
    for k, name in enumerate(("low", "right", "high", "left")):
        geometry.Append(["line", corners[k], corners[(k + 1) % 4]], bc=name)
    return ng.Mesh(geometry.GenerateMesh(maxh=maxh))


def panel(K: float, G: float) -> SpringProblem:
    """A problem of the default law, 1 mm thick."""
    return SpringProblem((ControlPoint(-20.0, -5.0),), T=1.0, K=K, G=G, domain="full")


def solid_of(mesh: Any, problem: SpringProblem, locking: bool = False) -> Solid:
    """The panel as the package treats it, or with all of K at every point."""
    space = ng.H1(mesh, order=2)
    n = int(space.ndof)
    left = np.flatnonzero(np.array(space.GetDofs(mesh.Boundaries("left")), bool))
    weight = np.ones(2 * n)
    weight[left] = weight[n + left] = 0.0
    matrix = numbered(np.arange(2 * n), weight, int(np.flatnonzero(weight)[-1]))[0].matrix
    # Nothing is prescribed: what would be d is one more unknown, and d an empty column.
    free = sp.csr_matrix(sp.hstack([matrix, sp.csr_matrix((2 * n, 1))]))
    if locking:

        def whole(u: Any, grad_u: Any) -> Any:
            return problem.law.energy(Gradient(ng.Id(2) + grad_u, ng.CF(1.0)))

        return Solid(mesh, whole, free)
    density: Density = lambda u, grad_u: strain_energy(u, grad_u, problem)  # noqa: E731
    return Solid(mesh, density, free, excess=excess_of(problem))


def tip(problem: SpringProblem, traction: float, maxh: float, locking: bool = False) -> float:
    """u_y in mm at the upper right corner, for a traction in MPa on the right side."""
    mesh = _mesh(maxh)
    solid = solid_of(mesh, problem, locking)
    v = solid.space.TestFunction()
    load = ng.LinearForm(solid.space)
    load += traction * v[1] * ng.ds("right")
    load.Assemble()
    given = solid.transposed @ np.array(load.vec.FV().NumPy())
    x = np.zeros(solid.free + 1)
    share, step = 0.0, 0.25
    while share < 1.0:
        reached = _balanced(solid, x, min(share + step, 1.0) * given)
        if reached is None:
            step /= 2
            assert step > 1e-3
            continue
        x, share = reached, min(share + step, 1.0)
    solid.set(solid.matrix @ x)
    return float(solid.u(mesh(48.0, 60.0))[1])


def _balanced(solid: Solid, x: FloatArray, given: FloatArray) -> FloatArray | None:
    for _ in range(15):
        force = (solid.transposed @ solid.forces(solid.matrix @ x) - given)[:-1]
        if not np.isfinite(force).all():
            return None
        tangent = solid.tangent(solid.matrix @ x)[:-1, :-1]
        update = spsolve(sp.csc_matrix(tangent), -force)
        x = x + np.append(update, 0.0)
        if np.abs(update).max() < 1e-9 * 48:
            return x
    return None
