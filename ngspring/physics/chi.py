"""What the design field means for density, stiffness and void: Eqs. 2, 3 and 15.

Every function takes a coefficient function of NGSolve (proxies, grid functions and formulas alike)
or an array, and returns the same kind.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from ngspring.basics.arrays import FloatArray
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


def void_indicator(chi: Field) -> Field:
    """I(chi), Eq. 15: smooth step from 0 for chi > -5 to 1 for chi < -6."""
    t = _ramp(-5 - chi)
    return t * t * t * (10 + t * (6 * t - 15))


def void_indicator_derivatives(chi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of I(chi), for the table of `ngspring.physics.void`."""
    t = _ramp(-5 - chi)
    return -30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
