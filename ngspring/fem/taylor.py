"""Taylor tests: whether a derivative is the derivative of its functional.

If ``f(x + t d) - f(x) - t f'(x) d`` shrinks like ``t^2``, and like ``t^3`` once the second
derivative is taken off as well, the derivatives are right; a wrong one leaves the lower order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import NgspringError

STEPS = tuple(1e-2 / 2**k for k in range(6))

# Below this multiple of the functional's rounding a remainder says nothing about its order.
_ROUNDING = 1e3 * np.finfo(float).eps


@dataclass(frozen=True)
class TaylorTest:
    """Outcome of `taylor_test`.

    Attributes
    ----------
    steps : array
        The steps t, as given.
    first_remainders : array
        ``|f(x + t d) - f(x) - t f'(x) d|`` for each step.
    second_remainders : array or None
        ``|f(x + t d) - f(x) - t f'(x) d - t^2/2 f''(x)(d, d)|``; None without a Hessian.
    first_order, second_order : float
        Order at which the remainders vanish, from the smallest two steps whose remainders stand
        clear of the functional's rounding: 2 and 3 (or more) if the derivatives are right, 1 and 2
        if they are not. ``inf`` if fewer than two do, that is, if the expansion is exact as far
        as can be seen; NaN without a Hessian, or if a value of the functional is not finite.
    """

    steps: FloatArray
    first_remainders: FloatArray
    second_remainders: FloatArray | None
    first_order: float
    second_order: float

    def __str__(self) -> str:
        second = self.second_remainders
        lines = [f"{'step':>10} {'first':>10}" + ("" if second is None else f" {'second':>10}")]
        for i, (t, first) in enumerate(zip(self.steps, self.first_remainders, strict=True)):
            tail = "" if second is None else f" {second[i]:10.2e}"
            lines.append(f"{t:10.2e} {first:10.2e}{tail}")
        tail = "" if second is None else f" {self.second_order:10.2f}"
        lines.append(f"{'order':>10} {self.first_order:10.2f}{tail}")
        return "\n".join(lines)


def taylor_test(
    functional: Callable[[FloatArray], float],
    gradient: Callable[[FloatArray], ArrayLike],
    x: ArrayLike,
    direction: ArrayLike,
    hessian: Callable[[FloatArray, FloatArray], ArrayLike] | None = None,
    steps: Iterable[float] = STEPS,
) -> TaylorTest:
    """Compare a functional along a line with its Taylor expansions of first and second order.

    Parameters
    ----------
    functional : callable
        ``functional(x) -> float``.
    gradient : callable
        ``gradient(x) -> array`` of the shape of x.
    x, direction : arrays of equal shape
        Where, and in which direction d, to expand; of any number of dimensions.
    hessian : callable, optional
        ``hessian(x, direction) -> array`` of the shape of x: the second derivative applied to d.
    steps : iterable of float
        At least two different positive steps t; 1e-2 halved five times by default.

    Returns
    -------
    TaylorTest

    Raises
    ------
    NgspringError
        If shapes do not match or the steps are not valid.

    Notes
    -----
    A second derivative is seen in the direction d only; for a matrix, test several directions.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.array([0.3, -0.2])
    >>> test = taylor_test(lambda x: np.sin(x).sum(), np.cos, x, np.array([1.0, 2.0]))
    >>> round(test.first_order)
    2
    """
    at, d = np.array(x, dtype=float), np.array(direction, dtype=float)
    _same_shape("direction", d, at)
    t = np.array(list(steps), dtype=float)
    if len(np.unique(t)) < 2 or not np.isfinite(t).all() or t.min() <= 0.0:
        raise NgspringError("steps must be at least two different positive numbers")
    start = float(functional(at.copy()))
    slope = _contract("gradient(x)", gradient(at.copy()), d)
    values = np.array([float(functional(at + step * d)) for step in t])
    first = values - start - t * slope
    size = max(abs(start), float(np.abs(values).max()))
    first_order = _order(t, first, size)
    if hessian is None:
        return TaylorTest(t, np.abs(first), None, first_order, float("nan"))
    curvature = _contract("hessian(x, direction)", hessian(at.copy(), d.copy()), d)
    second = first - t**2 / 2 * curvature
    second_order = _order(t, second, size)
    return TaylorTest(t, np.abs(first), np.abs(second), first_order, second_order)


def _same_shape(name: str, value: FloatArray, x: FloatArray) -> None:
    if value.shape != x.shape:
        raise NgspringError(f"{name} has shape {value.shape}, but x has {x.shape}")


def _contract(name: str, value: Any, direction: FloatArray) -> float:
    derivative = np.asarray(value, dtype=float)
    _same_shape(name, derivative, direction)
    return float((derivative * direction).sum())


def _order(steps: FloatArray, remainders: FloatArray, size: float) -> float:
    if not (np.isfinite(remainders).all() and np.isfinite(size)):
        return float("nan")
    falling = np.unique(steps, return_index=True)[1][::-1]
    steps, remainder = steps[falling], np.abs(remainders)[falling]
    clear = np.flatnonzero(remainder > _ROUNDING * size)[-2:]
    if len(clear) < 2:
        return float("inf")
    (t_0, t_1), (r_0, r_1) = steps[clear], remainder[clear]
    return float(np.log(r_0 / r_1) / np.log(t_0 / t_1))
