"""Powers of the two principal stretches in the plane, smooth where they are equal.

A principal stretch is a root of a quadratic equation, whose derivative is infinite where both are
equal; the sum of their powers is not. With ``l_1, l_2 = j^(1/2) e^(+-s)`` it is
``2 j^(alpha/2) cosh(alpha s)``, and as a function of ``z = sinh^2 s = (l_1 - l_2)^2 / (4 l_1 l_2)``
this cosine is hypergeometric (a Chebyshev function of ``1 + 2 z``): analytic at z = 0.

References
----------
NIST Digital Library of Mathematical Functions, 15.4.12 and 15.2.1.
"""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.physics.chi import CF

#: Below this z the power series is taken. There it needs about ten terms, and above it the closed
#: form loses no more than two digits of its second derivative.
SMALL = 1e-2


class MeanPowers:
    """``cosh(alpha s)`` with ``sinh^2 s = z``: the mean of l_1^alpha and l_2^alpha if l_1 l_2 = 1.

    Exact to rounding with its first and second derivative by z, for every z >= 0.

    Parameters
    ----------
    z : ngsolve.CoefficientFunction
    """

    def __init__(self, z: CF) -> None:
        self.z = z
        self._far = z - SMALL
        # Where a branch is not taken it must be finite all the same.
        apart = ng.IfPos(self._far, z, 1)
        self._s = ng.log(ng.sqrt(apart) + ng.sqrt(1 + apart))
        self._together = ng.IfPos(self._far, SMALL, z)

    def of(self, alpha: float) -> CF:
        """The mean for an exponent."""
        coefficients = power_series(alpha)
        if coefficients[-1] == 0.0:  # a polynomial: alpha is an even number
            return _polynomial(self.z, coefficients)
        power = ng.exp(alpha * self._s)
        closed = (power + 1 / power) / 2
        return ng.IfPos(self._far, closed, _polynomial(self._together, coefficients))


def power_series(alpha: float) -> FloatArray:
    """Coefficients of 1, z, z^2, ... as far as they count for z up to `SMALL`.

    The last one is zero if the series ends.
    """
    coefficients = [1.0]
    size = rounding = float(np.finfo(float).eps) * max(1.0, alpha**2)
    while coefficients[-1] != 0.0 and size >= rounding:
        k = len(coefficients) - 1
        ratio = (alpha**2 / 4 - k**2) / ((k + 0.5) * (k + 1))
        coefficients.append(coefficients[-1] * ratio)
        # Its second derivative is the last one to become small.
        size = abs(coefficients[-1]) * (k + 1) ** 2 * SMALL ** (k - 1)
    return np.array(coefficients)


def _polynomial(z: CF, coefficients: FloatArray) -> CF:
    value = ng.CF(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = coefficient + z * value
    return value
