"""The void regularisation of Eqs. 14 and 16 at the Gauss points.

The energy ``k_r K H^2 / 2 I(chi) Hu : Hu`` is quadratic in u and the elements are all the same
rectangle, so second derivatives at the nine Gauss points are one small table and the element
matrices are dense products of it. NGSolve's "hesse" operator has no vectorised evaluation; for
this one term the table is more than ten times faster than the symbolic form, to which the tests
compare it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.grid import ScalarSpace
from ngspring.physics.chi import CF, void_indicator, void_indicator_derivatives
from ngspring.physics.elasticity import measure
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.spring import SpringProblem

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


def dx() -> Any:
    """Integration with the nine Gauss points per element of 2.7 (exact to order 5)."""
    return ng.dx(intrules={ng.ET.QUAD: ng.IntegrationRule(ng.ET.QUAD, 5)})


def void_regularisation_scale(problem: SpringProblem) -> float:
    """k_r K H^2, the weight of the void regularisation in Eq. 14, in N.

    With no more of K than displacements carry (`ngspring.problem.material.split_bulk_modulus`): k_r
    means the same whatever the solid's K.
    """
    return problem.k_r * split_bulk_modulus(problem.K, problem.G)[0] * problem.H**2


def void_virtual_work(chi: CF, u: CF, lam: CF, problem: SpringProblem) -> CF:
    """Integrand over the mesh of ``k_r K H^2 I(chi) Hu : Hlam`` (Eqs. 16, 19), by NGSolve.

    Exact like the table of `VoidRegularisation`, and far slower.

    Parameters
    ----------
    chi : ngsolve.CoefficientFunction
    u, lam : proxies or grid functions of a vector-valued H1 space
    problem : SpringProblem
    """
    product = ng.InnerProduct(u.Operator("hesse"), lam.Operator("hesse"))
    return measure(problem) * void_regularisation_scale(problem) * void_indicator(chi) * product


@dataclass(frozen=True, eq=False)
class VoidBlocks:
    """Second derivatives of the void term, as element matrices flattened to (elements, 81).

    Rows and columns are the nine element dofs of ``ElementTable.dofs``. ``stiffness`` stands for
    both components of u; ``chi_u`` and ``chi_lam`` have one matrix per component,
    (2, elements, 81), with chi in the rows.
    """

    stiffness: FloatArray
    chi_u: FloatArray
    chi_lam: FloatArray
    chi_chi: FloatArray


class ElementTable:
    """Values and derivatives of the nine basis functions at the nine Gauss points.

    Attributes
    ----------
    dofs : int array (elements, 9)
        Of each element.
    value : array (9, 9)
        Rows are Gauss points, columns basis functions.
    gradient : array (2, 9, 9)
        By x and y.
    hesse : array (3, 9, 9)
        xx, yy and sqrt 2 xy.
    x, y : arrays (elements, 9)
        The Gauss points in mm.
    local : array (2, 9)
        The same from -1 to 1 across an element.
    weights : array (elements, 9)
        Of the integral over the whole spring.
    """

    def __init__(self, scalar: ScalarSpace) -> None:
        grid = scalar.grid
        self.ndof = scalar.ndof
        nx, ny = grid.cells
        hx, hy = grid.problem.h_x, grid.problem.h_y
        place = np.full((2 * nx + 1, 2 * ny + 1), -1)
        place[scalar.node[:, 0], scalar.node[:, 1]] = np.arange(scalar.ndof)
        i, j = (a.ravel() for a in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
        local = [(a, b) for a in range(3) for b in range(3)]
        self.dofs = np.stack([place[2 * i + a, 2 * j + b] for a, b in local], axis=1)

        s = (GAUSS_POINTS + 1) / 2
        # On a line: the vertex functions, and between them a bubble of height one.
        value = np.stack([1 - s, 4 * s * (1 - s), s])
        slope = np.stack([-np.ones(3), 4 - 8 * s, np.ones(3)])
        curvature = np.stack([np.zeros(3), np.full(3, -8.0), np.zeros(3)])
        height = scalar.bubble_value[self.dofs[0]]

        def table(in_x: FloatArray, in_y: FloatArray) -> FloatArray:
            product: FloatArray = np.einsum("ag,bh->ghab", in_x, in_y).reshape(9, 9)
            return np.asarray(product * height)

        self.value = table(value, value)
        self.gradient = np.stack([table(slope, value) / hx, table(value, slope) / hy])
        # H : H counts the mixed derivative twice.
        self.hesse = np.stack(
            [
                table(curvature, value) / hx**2,
                table(value, curvature) / hy**2,
                np.sqrt(2) * table(slope, slope) / (hx * hy),
            ]
        )
        gx, gy = (a.ravel() for a in np.meshgrid(s, s, indexing="ij"))
        self.local = np.stack([2 * gx - 1, 2 * gy - 1])
        self.x = hx * (i[:, None] + gx)
        self.y = hy * (j[:, None] + gy)
        weights = np.outer(GAUSS_WEIGHTS, GAUSS_WEIGHTS).ravel() / 4 * hx * hy
        self.weights = np.broadcast_to(weights * grid.problem.measure(self.x), self.x.shape)

    @property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of all element matrices, on the dofs."""
        return np.repeat(self.dofs, 9, axis=1).ravel(), np.tile(self.dofs, 9).ravel()

    def scatter(self, element_vectors: FloatArray) -> FloatArray:
        """Sum of element vectors (elements, 9) on the dofs."""
        summed = np.bincount(
            self.dofs.ravel(), weights=element_vectors.ravel(), minlength=self.ndof
        )
        return np.asarray(summed, dtype=float)


class VoidRegularisation:
    """Integrals of ``k_r K H^2 I(chi) Hu : Hv`` and their derivatives."""

    def __init__(self, scalar: ScalarSpace) -> None:
        self.table = table = ElementTable(scalar)
        self.scale = void_regularisation_scale(scalar.grid.problem)
        n, h = table.value, table.hesse
        self._hesse_hesse = np.einsum("kga,kgb->gab", h, h).reshape(9, 81)
        self._value_hesse = np.einsum("ga,kgb->kgab", n, h).reshape(27, 81)
        self._value_value = np.einsum("ga,gb->gab", n, n).reshape(9, 81)
        self._hesse_of_dofs = h.transpose(2, 0, 1).reshape(9, 27)

    def chi_at_points(self, chi: FloatArray) -> FloatArray:
        """chi at the Gauss points, (elements, 9), from its H1 dofs."""
        return np.asarray(chi[self.table.dofs] @ self.table.value.T)

    def hesse_at_points(self, u: FloatArray) -> FloatArray:
        """Second derivatives (xx, yy, sqrt 2 xy) of both components, (2, elements, 3, 9)."""
        components = u.reshape(2, self.table.ndof)[:, self.table.dofs]
        return np.asarray((components @ self._hesse_of_dofs).reshape(2, -1, 3, 9))

    def stiffness(self, chi_at_points: FloatArray) -> FloatArray:
        """Element matrices (elements, 81) of the second derivative with respect to u."""
        indicator = void_indicator(chi_at_points)
        return np.asarray((self.scale * self.table.weights * indicator) @ self._hesse_hesse)

    def _force(self, weights: FloatArray, hesse: FloatArray) -> FloatArray:
        moment = (hesse * weights[:, None, :]).reshape(2, -1, 27)
        element = moment @ self._hesse_of_dofs.T
        return np.concatenate([self.table.scatter(element[0]), self.table.scatter(element[1])])

    def forces(self, chi_at_points: FloatArray, u: FloatArray) -> FloatArray:
        """Derivative of the energy with respect to u, on the dofs of the VectorH1 space."""
        indicator = void_indicator(chi_at_points)
        weights = self.scale * self.table.weights * indicator
        return self._force(weights, self.hesse_at_points(u))

    def residual(
        self, chi_at_points: FloatArray, u: FloatArray, lam: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of ``I(chi) Hu : Hlam`` (integrated) with respect to chi, u and lam."""
        indicator = void_indicator(chi_at_points)
        first, _ = void_indicator_derivatives(chi_at_points)
        weights = self.scale * self.table.weights
        hesse_u, hesse_lam = self.hesse_at_points(u), self.hesse_at_points(lam)
        density = weights * first * (hesse_u * hesse_lam).sum(axis=(0, 2))
        return (
            self.table.scatter(density @ self.table.value),
            self._force(weights * indicator, hesse_lam),
            self._force(weights * indicator, hesse_u),
        )

    def blocks(self, chi_at_points: FloatArray, u: FloatArray, lam: FloatArray) -> VoidBlocks:
        """Second derivatives of ``I(chi) Hu : Hlam`` (integrated)."""
        indicator = void_indicator(chi_at_points)
        first, second = void_indicator_derivatives(chi_at_points)
        weights = self.scale * self.table.weights
        hesse_u, hesse_lam = self.hesse_at_points(u), self.hesse_at_points(lam)
        product = (hesse_u * hesse_lam).sum(axis=(0, 2))
        weighted = (weights * first)[None, :, None, :]
        return VoidBlocks(
            stiffness=(weights * indicator) @ self._hesse_hesse,
            chi_u=(weighted * hesse_lam).reshape(2, -1, 27) @ self._value_hesse,
            chi_lam=(weighted * hesse_u).reshape(2, -1, 27) @ self._value_hesse,
            chi_chi=(weights * second * product) @ self._value_value,
        )
