"""A design with every density and no symmetry beyond its own."""

from __future__ import annotations

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.problem.spring import SpringProblem


def rough_coefficients(problem: SpringProblem) -> FloatArray:
    """Solid (chi about 4) to void (about -7.5), with noise, on the coefficients of a problem."""
    column = Design.from_function(
        problem,
        lambda x, y: (
            6 * np.cos(2 * np.pi * (x / problem.L - 0.5))
            - 2
            + 3 * np.cos(2 * np.pi * y / problem.H) * np.cos(4 * np.pi * x / problem.L)
        ),
    )
    noise = np.random.default_rng(7).uniform(-0.4, 0.4, problem.coefficient_shape)
    return column.coefficients + noise
