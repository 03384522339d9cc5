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
from ngspring.problem.kinematics.base import Kinematics
from ngspring.problem.laws.base import Law, principal_stresses
from ngspring.problem.spring import SpringProblem

#: Logarithm of the transverse stretch up to which a state without transverse stress is looked for.
_FARTHEST = 50.0


def uniaxial_stress(stretch: float, law: Law, kinematics: Kinematics) -> float:
    """First Piola-Kirchhoff stress of a bar whose sides are free to move (Eq. 17).

    Parameters
    ----------
    stretch : float
        Length over original length.
    law : Law
    kinematics : Kinematics
        Whether it is free to contract in x only, or in both transverse directions.

    Returns
    -------
    float
        Force over original area in MPa; infinite where the law has no energy for such a stretch.

    Raises
    ------
    ProblemError
        If the stretch is not positive, or the law too unstable for such a state.
    """
    if not 0.0 < stretch < math.inf:
        raise ProblemError(f"a stretch of {stretch:g} is impossible: it must be positive")
    if stretch == 1.0:
        return 0.0  # not what rounding would leave

    def stresses(log_x: float) -> tuple[float, float]:
        """Transverse (Kirchhoff) and axial (nominal) stress."""
        transverse = math.exp(log_x)
        x, z = kinematics.free_stretches(transverse)
        across, along, _ = principal_stresses(law, x, stretch, z)
        return float(across) * transverse, float(along)

    # The transverse stress grows with the transverse stretch: its sign tells on which side of zero
    # the root is.
    log_x, at_rest = 0.0, stresses(0.0)[0]
    if not math.isfinite(at_rest):
        return math.copysign(math.inf, stretch - 1.0)

    def across(log_x: float) -> float:
        """Where chains lock the root has been passed."""
        value = stresses(log_x)[0]
        return value if math.isfinite(value) else -at_rest

    if at_rest != 0.0:
        reach = -math.copysign(max(abs(math.log(stretch)), 1e-3), at_rest)
        while across(reach) * at_rest > 0.0:
            reach *= 1.5
            if abs(reach) > _FARTHEST:
                raise ProblemError(
                    f"at a stretch of {stretch:g} the {law.name} law has no state with free sides:"
                    " it is not stable there"
                )
        log_x = brentq(across, 0.0, reach, xtol=1e-15, rtol=1e-14)
    along = stresses(log_x)[1]
    return along if math.isfinite(along) else math.copysign(math.inf, stretch - 1.0)


def block_stress(problem: SpringProblem, d: float) -> float:
    """Axial first Piola-Kirchhoff stress in MPa of the full solid block at a displacement d in mm.

    Raises
    ------
    ProblemError
        If d is not larger than -H.
    """
    stretch = 1 + d / problem.H
    return uniaxial_stress(stretch, problem.law, problem.motion)


def block_force(problem: SpringProblem, d: float) -> float:
    """Reaction force in N of the full solid block at a displacement d in mm.

    Raises
    ------
    ProblemError
        If d is not larger than -H.
    """
    return block_stress(problem, d) * problem.top_area
