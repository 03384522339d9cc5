"""The pressure field of a nearly incompressible solid: its excess bulk modulus, without locking.

As much of K as displacements carry without locking stays in the law, point by point (Eq. 14). What
K has more (`ngspring.problem.material.split_bulk_modulus`), with ``w`` its interpolation
(`ngspring.physics.chi.excess_stiffness`), enters through a field theta that is linear in each
element and may jump between elements::

    W(chi, u) = stationary value over theta of the integral of w(chi) (theta ln J - theta^2 / 2)

theta is the change of volume ln J, projected with the weight w, and w theta is the pressure. A
quadrilateral with nine nodes and such a linear pressure does not lock (inf-sup condition). The
weight lets the solid's part of an element decide: void does not dilute it. theta is eliminated in
the element, so that the system keeps its unknowns and its pattern; W is a function of chi and u
alone and its derivatives, adjoint ones included, are exact and symmetric. The part of K that stays
in the law is what resists ``J -> 0`` at every point, and with it contact in the third medium.

**How.** With ``m = (ln J)'[lam]`` the virtual work in direction lam is the stationary value over
theta and tau of::

    R = integral of w (theta m + tau (ln J - theta))

so theta and tau are the projections of ln J and of m, first derivatives are those at fixed theta
and tau, and second ones are ``R_xx + R_xtheta M^-1 R_taux + R_xtau M^-1 R_thetax`` with the matrix
M of the projection. All of them are written out at the Gauss points (as in
`ngspring.physics.void`); the tests compare with NGSolve's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.grid import ScalarSpace
from ngspring.physics.chi import excess_stiffness, excess_stiffness_derivatives
from ngspring.physics.void import ElementTable
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.spring import SpringProblem

_AT_A_TIME = 256


@dataclass(frozen=True, eq=False)
class PressureBlocks:
    """Second derivatives of the virtual work, as element matrices flattened to (..., elements, 81).

    Rows and columns are the nine element dofs of ``ElementTable.dofs``; the first indices are the
    components of u or lam: ``chi_u`` and ``chi_lam`` (2, elements, 81) with chi in the rows,
    ``u_u`` and ``u_lam`` (2, 2, elements, 81).
    """

    chi_chi: FloatArray
    chi_u: FloatArray
    chi_lam: FloatArray
    u_u: FloatArray
    u_lam: FloatArray


class _Volume:
    """ln J at the Gauss points, and its derivatives by what it is a function of.

    That is by the slopes of u (`PressureField.slopes`): of each component those by x and y, and of
    a body of revolution the displacement u_x itself, whose factor in the hoop stretch is `hoop`.
    """

    def __init__(self, slopes: FloatArray, hoop: FloatArray | None) -> None:
        (a, b), (c, d) = slopes[0, :, :2].swapaxes(0, 1), slopes[1, :, :2].swapaxes(0, 1)
        a, d = 1 + a, 1 + d
        self._det = a * d - b * c
        self.log_J: FloatArray = np.log(self._det)
        self.first = np.zeros_like(slopes)
        self.first[0, :, 0], self.first[0, :, 1] = d / self._det, -c / self._det
        self.first[1, :, 0], self.first[1, :, 1] = -b / self._det, a / self._det
        if hoop is not None:
            F_33 = 1 + hoop * slopes[0, :, 2]
            self.log_J = self.log_J + np.log(F_33)
            self.first[0, :, 2] = hoop / F_33
        self._revolved = hoop is not None

    def along(self, direction: FloatArray) -> FloatArray:
        """First derivative in a direction, (elements, 9)."""
        return np.asarray((self.first * direction).sum(axis=(0, 2)))

    def second(self, direction: FloatArray) -> FloatArray:
        """Second derivative with one direction given, in the shape of slopes."""
        result = np.zeros_like(direction)
        f, s = self.first[:, :, :2], direction[:, :, :2]
        # The cofactor of the direction.
        result[0, :, 0], result[0, :, 1] = s[1, :, 1], -s[1, :, 0]
        result[1, :, 0], result[1, :, 1] = -s[0, :, 1], s[0, :, 0]
        result /= self._det[:, None]
        result[:, :, :2] -= f * (f * s).sum(axis=(0, 2))[:, None]
        if self._revolved:
            result[0, :, 2] = -(self.first[0, :, 2] ** 2) * direction[0, :, 2]
        return result

    def second_matrix(self, weights: FloatArray) -> FloatArray:
        """Second derivative times weights, (2, 2, elements, slopes, slopes, 9)."""
        k = self.first.shape[2]
        result = np.zeros((2, 2, len(weights), k, k, 9))
        f = self.first[:, :, :2]
        weighted = f * weights[:, None]
        result[:, :, :, :2, :2] = -weighted[:, None, :, :, None] * f[None, :, :, None]
        self._add_cofactor(result, weights / self._det)
        if self._revolved:
            result[0, 0, :, 2, 2] = -weights * self.first[0, :, 2] ** 2
        return result

    def third_matrix(self, weights: FloatArray, direction: FloatArray) -> FloatArray:
        """Third derivative with one direction given, times weights, in the same shape."""
        k = self.first.shape[2]
        result = np.zeros((2, 2, len(weights), k, k, 9))
        f, s = self.first[:, :, :2], direction[:, :, :2]
        c = self.second(direction)[:, :, :2] * weights[:, None]
        product = -c[:, None, :, :, None] * f[None, :, :, None]
        result[:, :, :, :2, :2] = product + product.transpose(1, 0, 2, 4, 3, 5)
        self._add_cofactor(result, -weights * (f * s).sum(axis=(0, 2)) / self._det)
        if self._revolved:
            result[0, 0, :, 2, 2] = 2 * weights * self.first[0, :, 2] ** 3 * direction[0, :, 2]
        return result

    @staticmethod
    def _add_cofactor(matrix: FloatArray, weights: FloatArray) -> None:
        """Add weights times the (constant) second derivative of det F in the plane."""
        for c, d, sign in ((0, 1, 1.0), (1, 0, -1.0)):
            matrix[c, d, :, 0, 1] += sign * weights
            matrix[c, d, :, 1, 0] -= sign * weights


class _Projection:
    """Weighted least squares on functions that are linear in each element."""

    def __init__(self, weights: FloatArray, modes: FloatArray) -> None:
        self._weights, self._modes = weights, modes
        products = np.einsum("mg,ng->gmn", modes, modes).reshape(9, 9)
        #: M^-1, (elements, 3, 3).
        self.inverse: FloatArray = np.linalg.inv((weights @ products).reshape(-1, 3, 3))

    def __call__(self, values: FloatArray) -> FloatArray:
        """The projection at the Gauss points of values there."""
        moments = (self._weights * values) @ self._modes.T
        coefficients = np.einsum("emn,en->em", self.inverse, moments)
        return np.asarray(coefficients @ self._modes)


class PressureField:
    """W(chi, u) and the virtual work R(chi, u; lam) of the module, with their derivatives.

    Parameters
    ----------
    scalar : ScalarSpace
    table : ElementTable
        Of this space.
    """

    def __init__(self, scalar: ScalarSpace, table: ElementTable) -> None:
        self.problem: SpringProblem = scalar.grid.problem
        self.table = table
        self._scale = split_bulk_modulus(self.problem.K, self.problem.G)[1] * table.weights
        motion, L = self.problem.motion, self.problem.L
        #: Variation of the stretch out of the plane for u_x = 1, or None.
        self._hoop = motion.delta_F_33(np.ones_like(table.x), table.x, L)
        slopes = [*table.gradient, *([] if self._hoop is None else [table.value])]
        s, n = np.stack(slopes), table.value
        self._count = k = len(slopes)
        self._modes = np.stack([np.ones(9), *table.local])
        self._of_dofs = s.transpose(2, 0, 1).reshape(9, 9 * k)
        self._slope_slope = np.einsum("kga,lgb->klgab", s, s).reshape(9 * k * k, 81)
        self._value_slope = np.einsum("ga,kgb->kgab", n, s).reshape(9 * k, 81)
        self._value_value = np.einsum("ga,gb->gab", n, n).reshape(9, 81)
        self._value_mode = np.einsum("ga,mg->gam", n, self._modes).reshape(9, 27)

    @staticmethod
    def needed(problem: SpringProblem) -> bool:
        """Whether the solid is so nearly incompressible that there is an excess."""
        return split_bulk_modulus(problem.K, problem.G)[1] > 0.0

    @classmethod
    def where_needed(cls, scalar: ScalarSpace, table: ElementTable) -> PressureField | None:
        """One where it is `needed`, or None."""
        return cls(scalar, table) if cls.needed(scalar.grid.problem) else None

    @property
    def places(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of element matrices (2, 2, elements, 81) on the VectorH1 dofs."""
        n, (rows, columns) = self.table.ndof, self.table.pairs
        return (
            np.concatenate([rows, rows, rows + n, rows + n]),
            np.concatenate([columns, columns + n, columns, columns + n]),
        )

    def slopes(self, u: FloatArray) -> FloatArray:
        """Slopes of u at the Gauss points, (2, elements, k, 9): see `_Volume`."""
        components = u.reshape(2, self.table.ndof)[:, self.table.dofs]
        return np.asarray((components @ self._of_dofs).reshape(2, -1, self._count, 9))

    def _volume(self, u: FloatArray) -> _Volume:
        return _Volume(self.slopes(u), self._hoop)

    def _weights(self, chi_at_points: FloatArray) -> FloatArray:
        return np.asarray(self._scale * excess_stiffness(chi_at_points, self.problem))

    def _projection(self, weights: FloatArray) -> _Projection:
        return _Projection(weights, self._modes)

    # -- a given design ----------------------------------------------------------------------------

    def energy(self, chi_at_points: FloatArray, u: FloatArray) -> float:
        """W in N mm."""
        weights = self._weights(chi_at_points)
        with np.errstate(all="ignore"):
            theta = self._projection(weights)(self._volume(u).log_J)
        return float((weights * theta**2).sum()) / 2

    def forces(self, chi_at_points: FloatArray, u: FloatArray) -> FloatArray:
        """Derivative of W by u, on the dofs of the VectorH1 space."""
        weights = self._weights(chi_at_points)
        with np.errstate(all="ignore"):
            volume = self._volume(u)
            theta = self._projection(weights)(volume.log_J)
            return self._force((weights * theta)[:, None] * volume.first)

    def stiffness(
        self, chi_at_points: FloatArray, u: FloatArray, factor: FloatArray | float = 1.0
    ) -> FloatArray:
        """Element matrices (2, 2, elements, 81) of the second derivative by u.

        Parameters
        ----------
        chi_at_points : array (elements, 9)
        u : array (2 ndof,)
        factor : array (elements, 9), optional
            By which w is larger.
        """
        with np.errstate(all="ignore"):
            return self._stiffness(factor * self._weights(chi_at_points), self._volume(u))

    def _stiffness(self, weights: FloatArray, volume: _Volume) -> FloatArray:
        projection = self._projection(weights)
        theta = projection(volume.log_J)
        moments = self._moments(weights[:, None] * volume.first)
        by_theta = projection.inverse @ moments.swapaxes(2, 3)
        of_theta = moments[:, None] @ by_theta[None]
        return self._matrices(volume.second_matrix(weights * theta)) + _flat(of_theta)

    # -- the coupled system ------------------------------------------------------------------------

    def residual(
        self, chi_at_points: FloatArray, u: FloatArray, lam: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of R by chi, u and lam."""
        weights = self._weights(chi_at_points)
        first = self._scale * excess_stiffness_derivatives(chi_at_points, self.problem)[0]
        with np.errstate(all="ignore"):
            volume, direction = self._volume(u), self.slopes(lam)
            projection, along = self._projection(weights), volume.along(direction)
            theta, tau = projection(volume.log_J), projection(along)
            density = first * (theta * along + tau * (volume.log_J - theta))
            stress = theta[:, None] * volume.second(direction) + tau[:, None] * volume.first
            return (
                self.table.scatter(density @ self.table.value),
                self._force(weights[:, None] * stress),
                self._force((weights * theta)[:, None] * volume.first),
            )

    def blocks(self, chi_at_points: FloatArray, u: FloatArray, lam: FloatArray) -> PressureBlocks:
        """Second derivatives of R."""
        elements = len(chi_at_points)
        result = PressureBlocks(
            chi_chi=np.empty((elements, 81)),
            chi_u=np.empty((2, elements, 81)),
            chi_lam=np.empty((2, elements, 81)),
            u_u=np.empty((2, 2, elements, 81)),
            u_lam=np.empty((2, 2, elements, 81)),
        )
        slopes, direction = self.slopes(u), self.slopes(lam)
        # A few elements at a time: what is computed on the way stays in the processor's cache.
        for begin in range(0, elements, _AT_A_TIME):
            part = slice(begin, begin + _AT_A_TIME)
            with np.errstate(all="ignore"):
                self._write_blocks(result, part, chi_at_points, slopes, direction)
        return result

    def _write_blocks(
        self,
        result: PressureBlocks,
        part: slice,
        chi_at_points: FloatArray,
        slopes: FloatArray,
        direction: FloatArray,
    ) -> None:
        """The blocks of some of the elements."""
        chi, scale, direction = chi_at_points[part], self._scale[part], direction[:, part]
        w = scale * excess_stiffness(chi, self.problem)
        w_1, w_2 = (scale * x for x in excess_stiffness_derivatives(chi, self.problem))
        volume = _Volume(slopes[:, part], None if self._hoop is None else self._hoop[part])
        projection, along, first = self._projection(w), volume.along(direction), volume.first
        theta, tau, second = projection(volume.log_J), projection(along), volume.second(direction)
        rest = volume.log_J - theta
        stress = theta[:, None] * second + tau[:, None] * first
        curvature = volume.third_matrix(w * theta, direction) + volume.second_matrix(w * tau)

        # Mixed derivatives by chi, u_x, u_y and by theta (3 columns) and tau (3 more) ...
        left = np.empty((3, len(w), 9, 6))
        left[0, :, :, :3] = self._chi_moments(w_1 * (along - tau))
        left[0, :, :, 3:] = self._chi_moments(w_1 * rest)
        left[1:, :, :, :3] = self._moments(w[:, None] * second)
        left[1:, :, :, 3:] = self._moments(w[:, None] * first)
        # ... and M^-1 times those by tau and theta. Those of lam and theta are like u's by tau.
        right = np.empty((3, len(w), 6, 9))
        right[:, :, :3] = projection.inverse @ left[..., 3:].swapaxes(2, 3)
        right[:, :, 3:] = projection.inverse @ left[..., :3].swapaxes(2, 3)
        by_tau, of_lam = left[..., 3:], right[1:, :, :3]

        result.chi_chi[part] = (w_2 * (theta * along + tau * rest)) @ self._value_value
        result.chi_chi[part] += _flat(left[0] @ right[0])
        result.chi_u[:, part] = self._chi_matrices(w_1[:, None] * stress)
        result.chi_u[:, part] += _flat(left[0] @ right[1:])
        result.chi_lam[:, part] = self._chi_matrices((w_1 * theta)[:, None] * first)
        result.chi_lam[:, part] += _flat(by_tau[0] @ of_lam)
        result.u_u[:, :, part] = self._matrices(curvature)
        result.u_u[:, :, part] += _flat(left[1:, None] @ right[None, 1:])
        result.u_lam[:, :, part] = self._matrices(volume.second_matrix(w * theta))
        result.u_lam[:, :, part] += _flat(by_tau[1:, None] @ of_lam[None])

    # -- sums over Gauss points and elements -------------------------------------------------------

    def _force(self, stress: FloatArray) -> FloatArray:
        """On the dofs of the VectorH1 space, from what works on the slopes."""
        element = stress.reshape(2, -1, 9 * self._count) @ self._of_dofs.T
        return np.concatenate([self.table.scatter(element[0]), self.table.scatter(element[1])])

    def _moments(self, stress: FloatArray) -> FloatArray:
        """The same for each of the three functions of theta: (2, elements, 9, 3)."""
        each = stress * self._modes[:, None, None, None]
        element = each.reshape(3, 2, -1, 9 * self._count) @ self._of_dofs.T
        return np.ascontiguousarray(element.transpose(1, 2, 3, 0))

    def _chi_moments(self, density: FloatArray) -> FloatArray:
        """The same for the dofs of chi: (elements, 9, 3)."""
        return np.asarray((density @ self._value_mode).reshape(-1, 9, 3))

    def _chi_matrices(self, stress: FloatArray) -> FloatArray:
        """Element matrices (2, elements, 81), chi in the rows."""
        return np.asarray(stress.reshape(2, -1, 9 * self._count) @ self._value_slope)

    def _matrices(self, curvature: FloatArray) -> FloatArray:
        """Element matrices (2, 2, elements, 81) from a second derivative by the slopes."""
        flat = curvature.reshape(4, -1, 9 * self._count**2)
        return np.asarray((flat @ self._slope_slope).reshape(2, 2, -1, 81))


def _flat(matrices: FloatArray) -> FloatArray:
    """Element matrices (..., 9, 9) as (..., 81)."""
    return matrices.reshape(*matrices.shape[:-2], 81)
