"""The unknowns of the coupled system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.problem.spring import SpringProblem


@dataclass
class State:
    """All unknowns of the coupled system.

    Attributes
    ----------
    chi : array (coefficients,)
        Spline coefficients, flattened.
    u : array (control points, free)
        Free displacements in mm.
    lam : array (control points, free + 1)
        Adjoint displacements in N^-1; the last one, lam_Ty, is ``w (q - q_*)``. A control point
        with an imperfection has more free displacements; where others have none there is 0.
    """

    chi: FloatArray
    u: FloatArray
    lam: FloatArray

    def moved(self, update: State) -> State:
        """The state after a Newton update."""
        return State(self.chi + update.chi, self.u + update.u, self.lam + update.lam)

    def forces(self, problem: SpringProblem) -> FloatArray:
        """Reaction forces q_j in N."""
        points = problem.control_points
        target = np.array([point.q_star for point in points])
        return np.asarray(target + self.lam[:, -1] / [point.weight for point in points])
