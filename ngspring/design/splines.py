"""C1 quadratic B-splines on a uniform grid: the space of the design field chi (2.7).

On a line with ``cells`` cells of length ``h`` the uniform quadratic B-splines are numbered
``k = 0 ... cells + 1``; spline ``k`` is centred at its Greville point ``(k - 1/2) h``, so the
first and the last one have their centre half a cell outside the line (the *ghost layer*).
chi is a tensor product of two such lines. The symmetries of the paper fold coefficients onto each
other:

- in x, ``c_k = c_{N+1-k}`` (mirror line in the middle); nothing is imposed on the sides, so the
  ghost coefficient stays independent: ``N/2 + 1`` of them;
- in y, the same mirror line, and a zero normal derivative at bottom and top, ``c_0 = c_1``:
  ``N/2`` of them.

A design is therefore an array of shape ``(N/2 + 1, N/2)`` whatever domain it is analysed on.
"""

from __future__ import annotations

import numpy as np

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.problem.spring import SpringProblem


def fold_x(elements: int) -> IntArray:
    """Independent coefficient of each of the ``elements + 2`` splines in x."""
    k = np.arange(elements + 2)
    return np.minimum(k, elements + 1 - k)


def fold_y(elements: int) -> IntArray:
    """Independent coefficient of each of the ``elements + 2`` splines in y."""
    k = np.arange(elements + 2)
    return np.maximum(np.minimum(k, elements + 1 - k), 1) - 1


def greville_points(problem: SpringProblem) -> tuple[FloatArray, FloatArray]:
    """Greville points of the independent coefficients.

    Returns
    -------
    x, y : arrays of shape ``(N/2 + 1, N/2)``
        Coordinates in mm from the lower left corner of the full domain: cell centres of the lower
        left quarter, and in x one ghost column half a cell outside the left side.
    """
    nx, ny = problem.coefficient_shape
    x = (np.arange(nx) - 0.5) * problem.h_x
    y = (np.arange(ny) + 0.5) * problem.h_y
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    return grid_x, grid_y


def _values_and_index(
    t: FloatArray, h: float, cells: int, derivative: int
) -> tuple[IntArray, tuple[FloatArray, ...]]:
    cell = np.clip(np.floor(t / h).astype(np.int64), 0, cells - 1)
    s = t / h - cell
    if derivative == 0:
        return cell, (0.5 * (1 - s) ** 2, 0.5 + s * (1 - s), 0.5 * s**2)
    if derivative == 1:
        return cell, ((s - 1) / h, (1 - 2 * s) / h, s / h)
    one = np.ones_like(s) / h**2
    return cell, (one, -2 * one, one)


def evaluate(
    problem: SpringProblem,
    coefficients: FloatArray,
    x: FloatArray,
    y: FloatArray,
    derivative: tuple[int, int] = (0, 0),
) -> FloatArray:
    """chi, or one of its derivatives, anywhere in the full domain.

    Parameters
    ----------
    problem : SpringProblem
    coefficients : array of shape ``problem.coefficient_shape``
    x, y : arrays (broadcast against each other)
        Points in mm from the lower left corner of the full domain.
    derivative : pair of int
        Order of the derivative in x and in y, each 0, 1 or 2.

    Raises
    ------
    ValueError
        For a point outside the domain, or NaN (a rounding error outside is accepted).
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    for name, value, size in (("x", x, problem.L), ("y", y, problem.H)):
        bad = ~((value >= -1e-9 * size) & (value <= (1 + 1e-9) * size))
        if bad.any():
            raise ValueError(
                f"{name} = {value[bad].flat[0]:g} lies outside the domain, 0 <= {name} <= {size:g}"
            )
    cells = problem.elements
    ix, iy = fold_x(cells), fold_y(cells)
    if x.ndim == y.ndim == 2 and x.shape[1] == y.shape[0] == 1:
        # On a grid a picture is drawn of, the lines in x and in y are evaluated one by one.
        along_x = _matrix(x[:, 0], problem.h_x, cells, derivative[0], ix)
        along_y = _matrix(y[0], problem.h_y, cells, derivative[1], iy)
        return np.asarray(along_x @ coefficients @ along_y.T)
    x, y = np.broadcast_arrays(x, y)
    i, weights_x = _values_and_index(x, problem.h_x, cells, derivative[0])
    j, weights_y = _values_and_index(y, problem.h_y, cells, derivative[1])
    result = np.zeros(x.shape)
    for a in range(3):
        for b in range(3):
            result += weights_x[a] * weights_y[b] * coefficients[ix[i + a], iy[j + b]]
    return result


def _matrix(t: FloatArray, h: float, cells: int, derivative: int, fold: IntArray) -> FloatArray:
    """Coefficients along a line -> values, or derivatives, at places t of it."""
    cell, weights = _values_and_index(t, h, cells, derivative)
    matrix = np.zeros((len(t), int(fold.max()) + 1))
    for a in range(3):
        # Two splines of a place may be one after folding: they add up.
        matrix[np.arange(len(t)), fold[cell + a]] += weights[a]
    return matrix
