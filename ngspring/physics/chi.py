"""What the design field means for density, stiffness and void: Eqs. 2, 3 and 15.

Every function takes a coefficient function of NGSolve (proxies, grid functions and formulas alike)
or an array, and returns the same kind.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.spring import SpringProblem

#: A coefficient function of NGSolve, which has no type information of its own.
CF: TypeAlias = Any
#: A coefficient function or an array.
Field: TypeAlias = Any

_NUMBERS = (np.ndarray, np.generic, float, int)

#: Deeper in the void exp(-chi) would overflow; the density is 1e-87 here.
_DEEPEST = -200.0


def _ngsolve() -> Any:
    """NGSolve, which takes a while to import: pictures are drawn from arrays without it."""
    import ngsolve

    return ngsolve


def _decay(chi: Field) -> Field:
    """exp(-chi)."""
    if isinstance(chi, _NUMBERS):
        return np.exp(-np.maximum(chi, _DEEPEST))
    ng = _ngsolve()
    return ng.exp(-ng.IfPos(chi - _DEEPEST, chi, _DEEPEST))


def _ramp(t: Field) -> Field:
    """t, no less than 0 and no more than 1."""
    if isinstance(t, _NUMBERS):
        return np.clip(t, 0.0, 1.0)
    ng = _ngsolve()
    return ng.IfPos(t, ng.IfPos(t - 1, 1, t), 0)


def rho(chi: Field) -> Field:
    """Material density, the sigmoid of the design field (Eq. 2)."""
    return 1 / (1 + _decay(chi))


def stiffness(chi: Field, problem: SpringProblem) -> Field:
    """RAMP interpolation E(chi) of the stiffness between E_0 (void) and 1 (solid), Eq. 3.

    With Eq. 2 inserted, ``rho / (1 + p (1 - rho)) = 1 / (1 + (1 + p) exp(-chi))``.
    """
    e_0, p = problem.E_0, problem.p
    return e_0 + (1 - e_0) / (1 + (1 + p) * _decay(chi))


def excess_stiffness(chi: Field, problem: SpringProblem) -> Field:
    """Interpolation of the excess bulk modulus, which a pressure field carries, by Eq. 3.

    With ``1 + p`` larger and ``E_0`` smaller by K over its part that displacements carry: in solid
    it is 1, while grey and void have at most twice the bulk modulus that E(chi) gives them. With
    E(chi) itself a grey of a thousandth of the stiffness could not be compressed, and would keep
    surfaces apart that are about to touch.
    """
    e_0, s = _excess_ramp(chi, problem)
    return e_0 + (1 - e_0) * s


def excess_stiffness_derivatives(
    chi: FloatArray, problem: SpringProblem
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of `excess_stiffness`."""
    e_0, s = _excess_ramp(chi, problem)
    first = (1 - e_0) * s * (1 - s)
    return first, first * (1 - 2 * s)


def _excess_ramp(chi: Field, problem: SpringProblem) -> tuple[float, Field]:
    """Its value in void, and the sigmoid from there to 1."""
    ratio = problem.K / split_bulk_modulus(problem.K, problem.G)[0]
    return problem.E_0 / ratio, 1 / (1 + (1 + problem.p) * ratio * _decay(chi))


def smooth_step(t: Field) -> Field:
    """0 for t < 0, 1 for t > 1, and between them of degree 5, with two derivatives (Eq. 15)."""
    t = _ramp(t)
    return t * t * t * (10 + t * (6 * t - 15))


def void_indicator(chi: Field) -> Field:
    """I(chi), Eq. 15: smooth step from 0 for chi > -5 to 1 for chi < -6."""
    return smooth_step(-5 - chi)


def void_indicator_derivatives(chi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of I(chi), for the table of `ngspring.physics.void`."""
    t = _ramp(-5 - chi)
    return -30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
