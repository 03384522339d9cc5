"""Is a stored design a stationary point? Answered from its chi alone (Eqs. 4, 7, 8)."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.fem.process import parallel
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem, Residual
from ngspring.physics.grey import grey_share
from ngspring.problem.point import deviation


@dataclass(frozen=True, eq=False)
class Optimality:
    """Outcome of `optimality`.

    Attributes
    ----------
    residual : float
        Norm of Eq. 8's residual at dt = infinity relative to the norm of its terms (the square
        root of the sum of their squared norms).
    terms : dict
        Norm of each term: volume, interface, curvature, and one per control point.
    q, targets : arrays
        Reaction forces and target forces at the control points in N.
    grey : tuple of float
        See `grey_shares`.
    deviation : array
        Relative to the targets, or the largest one where nothing is asked for; positive is stiffer
        or stronger than asked.
    """

    residual: float
    terms: dict[str, float]
    q: FloatArray
    targets: FloatArray
    grey: tuple[float, ...]

    @property
    def deviation(self) -> FloatArray:
        """Relative deviation of each reaction force from its target."""
        sizes = np.abs(self.targets)
        sizes = np.where(sizes == 0.0, sizes.max(), sizes)
        return np.asarray(deviation(self.q, self.targets) / np.where(sizes == 0.0, np.nan, sizes))


def grey_shares(system: CoupledSystem, state: State) -> tuple[float, ...]:
    """Share of the strain energy in grey at each control point without an offset eta.

    See `ngspring.design.soundness`.
    """
    mesh = system.grid.mesh
    chi = ng.GridFunction(system.scalar.space)
    u = ng.GridFunction(ng.VectorH1(mesh, order=2))
    chi.vec.FV().NumPy()[:] = system.extraction_chi @ state.chi
    shares = []
    for j, point in enumerate(system.points):
        if point.own:
            ndof = system.scalar.ndof
            u.vec.FV().NumPy()[:] = system.control_point_vector(state, j)[ndof : 3 * ndof]
            shares.append(grey_share(chi, u, mesh, system.problem))
    return tuple(shares)


def _relative(residual: Residual) -> float:
    size = float(np.sqrt(sum(norm**2 for norm in residual.chi_terms.values())))
    return float(np.linalg.norm(residual.chi)) / size if size > 0 else 0.0


def relative_optimality(system: CoupledSystem, state: State) -> float:
    """Norm of Eq. 8's residual without transient term, relative to its terms."""
    return _relative(system.residual(state, state.chi, np.inf))


def optimality(
    design: Design, *, domain: str | None = None, threads: int | None = None, solver: str = "auto"
) -> Optimality:
    """Re-assemble everything for a stored design and return Eq. 8's residual.

    Mechanics are solved from the undeformed state and adjoints from their equations; nothing but
    chi and the problem is taken from the file.

    Parameters
    ----------
    design : Design
    domain : {"quarter", "full"}, optional
        Overrides the problem's.
    threads, solver
        See `ngspring.optimize`.

    Raises
    ------
    ConvergenceError
        If a control point cannot be reached from the undeformed state.
    """
    problem = design.problem if domain is None else design.problem.replace(domain=domain)
    with parallel(threads, problem) as count:
        system = CoupledSystem(problem, solver, count)
        state = initial_state(system, design)
        residual = system.residual(state, state.chi, np.inf)
        grey = grey_shares(system, state)
    targets = np.array([point.q_star for point in problem.control_points])
    return Optimality(
        residual=_relative(residual),
        terms=residual.chi_terms,
        q=state.forces(problem),
        targets=targets,
        grey=grey,
    )
