"""The full solid block: what a spring that fills the whole domain would carry.

With rho = 1 everywhere, the boundary conditions of section 2.5 allow a homogeneous state of
uniaxial stress: the sides move as straight lines and no force acts on them. So the force at a
prescribed d follows from one scalar equation for the transverse stretch.

No design stores more energy than the block at the same d: with less stiffness somewhere, the least
energy of all admissible displacements cannot be higher. Its force is therefore the natural upper
bound for a target.
"""

from __future__ import annotations

import math

from scipy.optimize import brentq

from ngspring.basics.errors import ProblemError
from ngspring.problem.spring import SpringProblem


def _stresses(
    log_x: float, log_y: float, K: float, G: float, axisymmetric: bool
) -> tuple[float, float]:
    """Kirchhoff stresses (transverse, axial) for principal log stretches (Eq. 17)."""
    log_z = log_x if axisymmetric else 0.0
    log_det = log_x + log_y + log_z
    squares = [math.exp(2 * value) for value in (log_x, log_y, log_z)]
    mean = sum(squares) / 3
    isochoric = G * math.exp(-2 / 3 * log_det)
    return (
        K * log_det + isochoric * (squares[0] - mean),
        K * log_det + isochoric * (squares[1] - mean),
    )


def uniaxial_stress(stretch: float, K: float, G: float, *, axisymmetric: bool = False) -> float:
    """First Piola-Kirchhoff stress of a bar of the neo-Hookean solid, free to contract (Eq. 17).

    Parameters
    ----------
    stretch : float
        Length over original length.
    K, G : float
        Bulk and shear modulus.
    axisymmetric : bool
        Uniaxial stress, instead of plane strain with one free side.

    Returns
    -------
    float
        Force over original area, in the units of the moduli.

    Raises
    ------
    ProblemError
        If the stretch is not positive.
    """
    if not 0.0 < stretch < math.inf:
        raise ProblemError(f"a stretch of {stretch:g} is impossible: it must be positive")
    log_y = math.log(stretch)

    def transverse(log_x: float) -> float:
        return _stresses(log_x, log_y, K, G, axisymmetric)[0]

    # The transverse stress grows with the transverse stretch: its sign tells on which side of zero
    # the root is.
    log_x, at_rest = 0.0, transverse(0.0)
    if at_rest != 0.0:
        reach = -math.copysign(max(abs(log_y), 1e-3), at_rest)
        while transverse(reach) * at_rest > 0.0:
            reach *= 1.5
        log_x = brentq(transverse, 0.0, reach, xtol=1e-15, rtol=1e-14)
    axial = _stresses(log_x, log_y, K, G, axisymmetric)[1]
    return axial / stretch


def block_stress(problem: SpringProblem, d: float) -> float:
    """Axial first Piola-Kirchhoff stress in MPa of the full solid block at a displacement d in mm.

    Raises
    ------
    ProblemError
        If d is not larger than -H.
    """
    stretch = 1 + d / problem.H
    return uniaxial_stress(stretch, problem.K, problem.G, axisymmetric=problem.motion.axis)


def block_force(problem: SpringProblem, d: float) -> float:
    """Reaction force in N of the full solid block at a displacement d in mm.

    Raises
    ------
    ProblemError
        If d is not larger than -H.
    """
    return block_stress(problem, d) * problem.top_area
