"""Does a spring stay symmetric? Lowest eigenvalues of the full-domain tangent (issue 3, item 5).

A design is doubly symmetric and its load path is followed on one quarter, which allows symmetric
deformation only. Here the same states are mirrored to the full domain, where nothing but the
boundary conditions of 2.5 restricts the displacements, and the tangent K at a prescribed d is
examined: while K is positive definite the symmetric state is a minimum of the energy under
displacement control; where its lowest eigenvalue becomes negative the spring leaves the path.

Which eigenvalues
-----------------
``K v = lambda M v`` with M the *linear-elastic stiffness of the undeformed design*, E(chi)
included and the void regularisation left out: ``v.M v`` is twice the energy that v would cost in
small strains. lambda is then a pure number, the share of its stiffness that the weakest
deformation has left, and does not depend on the mesh. At rest it is 1 (K = M plus the void
regularisation), where prestress acts linearly it is ``1 - load / buckling load``, at a critical
point it is 0. The sign of the lowest eigenvalue, and how many are negative, do not depend on M
(Sylvester); its size does:

- with the plain L2 mass the void's modes, a million times softer than the solid's, come first;
- with an E(chi)-weighted mass a column that is free to move sideways in the void, or an island of
  grey, comes first: a mechanism that only the void holds, nearly zero and harmless. With M as
  above the void holds itself (lambda of 1 or, with the regularisation, much more).

Whether a mode is the spring's or the third medium's own is seen from where it strains the
material, see `Mode.shares`. Axisymmetric springs are examined for axisymmetric modes only.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ngspring.design import Design
from ngspring.errors import ConvergenceError, ProblemError
from ngspring.mechanics import Equilibrium, Mechanics
from ngspring.path import follow
from ngspring.problem import SpringProblem
from ngspring.response import nodal_values
from ngspring.spaces import Grid, ScalarSpace, spline_extraction
from ngspring.splines import FloatArray
from ngspring.states import curve_displacements
from ngspring.threads import parallel
from ngspring.void import smooth_step

logger = logging.getLogger(__name__)

#: Eigenvalues smaller than this in size are zero within rounding (a mechanism, not an instability).
ZERO = 1e-8
_MOST_NEGATIVE = 24
_VOID = -5.0
_KINDS = ("solid", "grey", "void")


@dataclass(frozen=True, eq=False)
class Mode:
    """An eigenvector of the tangent.

    Attributes
    ----------
    eigenvalue : float
        lambda, see the module's description.
    nodes : array (2, nx, ny)
        The mode at the vertices, edge middles and centres of the full domain's mesh; largest
        component 1.
    shares : tuple of 3 float
        Parts of the mode's strain energy in solid (chi >= 0), grey (-5 < chi < 0) and void. The
        strain is the one with respect to the deformed state, so that turning a deformed part
        counts nothing; the energy is the linear-elastic one, scaled with E(chi), and that of the
        void regularisation.
    parity : tuple of 2 float
        1 for a mode that is symmetric about x = L/2 (about y = H/2), -1 for an antisymmetric one,
        in between for a mixture. Symmetric about both: the mode of the quarter.
    """

    eigenvalue: float
    nodes: FloatArray
    shares: tuple[float, float, float]
    parity: tuple[float, float]

    @property
    def kind(self) -> str:
        """Where most of its strain energy is: "solid", "grey" or "void"."""
        return _KINDS[int(np.argmax(self.shares))]

    @property
    def symmetry(self) -> tuple[str, str]:
        """In x and in y: "symmetric", "antisymmetric" or "mixed"."""
        names = ["mixed" if abs(p) < 0.9 else "symmetric" if p > 0 else "antisymmetric"
                 for p in self.parity]
        return names[0], names[1]


@dataclass(frozen=True, eq=False)
class StabilityPoint:
    """The tangent at one displacement.

    Attributes
    ----------
    d, q : float
        Displacement in mm and reaction force in N.
    modes : tuple of Mode
        Those with the lowest eigenvalues, in increasing order: all negative ones as far as they
        are known (at most 24), and a few positive ones.
    negative : int or None
        How many eigenvalues are negative by the inertia of the factorisation, an independent
        count; None if the linear solver does not tell.
    imbalance : float
        Norm of the forces on the full domain's free displacements at the mirrored state relative
        to the force q (to the stiffness times 1e-3 H near rest): rounding.
    u : array (2, nx, ny)
        The mirrored state at the nodes of the full domain's mesh in mm.
    """

    d: float
    q: float
    modes: tuple[Mode, ...]
    negative: int | None
    imbalance: float
    u: FloatArray

    def lowest_of(self, kind: str | None = None) -> Mode | None:
        """The lowest mode, or the lowest of a kind; None if no computed mode is of this kind."""
        return next((m for m in self.modes if kind is None or m.kind == kind), None)

    @property
    def lowest(self) -> float:
        """The lowest eigenvalue."""
        return self.modes[0].eigenvalue

    @property
    def verdict(self) -> str:
        """"stable", "neutral" (zero within rounding) or "unstable"."""
        if self.lowest < -ZERO:
            return "unstable"
        return "neutral" if self.lowest <= ZERO else "stable"


@dataclass(frozen=True, eq=False)
class Critical:
    """Where the lowest eigenvalue of all modes, or of those in the solid, becomes zero.

    Attributes
    ----------
    d, q : float
        Displacement in mm and reaction force in N.
    bracket : tuple of 2 float
        Displacements of the last stable and the first unstable state computed.
    point : StabilityPoint
        The computed state nearest to it.
    mode : Mode
        Its critical mode.
    """

    d: float
    q: float
    bracket: tuple[float, float]
    point: StabilityPoint
    mode: Mode


@dataclass(frozen=True, eq=False)
class Stability:
    """Outcome of `stability`.

    Attributes
    ----------
    problem : SpringProblem
    points : tuple of StabilityPoint
        One per requested displacement that was reached, in increasing order of d.
    critical : tuple of Critical
        First loss of stability on the way from rest, in compression and in tension, if any.
        Where it is one of grey or void, a later one of the solid follows it, if any.
    rest : float
        The lowest eigenvalue at d = 0.
    complete : bool
        Whether every displacement was reached.
    message : str
        Where and why the path ended, if it did.
    """

    problem: SpringProblem
    points: tuple[StabilityPoint, ...]
    critical: tuple[Critical, ...]
    rest: float
    complete: bool
    message: str

    @property
    def d(self) -> FloatArray:
        """Displacements in mm."""
        return np.array([point.d for point in self.points])

    @property
    def q(self) -> FloatArray:
        """Reaction forces in N."""
        return np.array([point.q for point in self.points])

    @property
    def relative(self) -> FloatArray:
        """Lowest eigenvalues relative to the one at d = 0."""
        return np.array([point.lowest for point in self.points]) / self.rest

    @property
    def stable(self) -> bool:
        """Whether no computed state is unstable."""
        return not self.critical and all(p.verdict != "unstable" for p in self.points)

    @property
    def spring_stable(self) -> bool:
        """Whether no computed state has an unstable mode that lives in the solid."""
        modes = [m for p in (*self.points, *(c.point for c in self.critical)) for m in p.modes]
        return not any(mode.kind == "solid" and mode.eigenvalue < -ZERO for mode in modes)


def mirrored(part: ScalarSpace, whole: ScalarSpace, field: FloatArray, d: float) -> FloatArray:
    """A quarter's displacement field on the full domain, dofs of the VectorH1 spaces.

    ``u_x(L - x, y) = -u_x(x, y)`` and ``u_y(x, H - y) = d - u_y(x, y)``: exact, because the basis
    is hierarchical. A bubble's dof is mirrored like the field; the constant d has no bubbles.

    Parameters
    ----------
    part, whole : ScalarSpace
        Of domain "quarter" and "full" of the same problem.
    field : array (2 ndof of part,)
    d : float
        Displacement of the top side in mm.
    """
    nx, ny = (2 * cells for cells in part.grid.cells)
    i, j = whole.node[:, 0], whole.node[:, 1]
    right, upper = i > nx, j > ny
    place = np.zeros((nx + 1, ny + 1), dtype=np.int64)
    place[part.node[:, 0], part.node[:, 1]] = np.arange(part.ndof)
    twin = place[np.where(right, 2 * nx - i, i), np.where(upper, 2 * ny - j, j)]
    height = part.bubble_value[twin] / whole.bubble_value
    u_x, u_y = field.reshape(2, -1)[:, twin] * height
    constant = np.where((i % 2 == 0) & (j % 2 == 0), d, 0.0)
    return np.concatenate([np.where(right, -u_x, u_x), np.where(upper, constant - u_y, u_y)])


class FullTangent(Mechanics):
    """The tangent on the full domain, its inertia and its lowest eigenvalues."""

    def __init__(
        self, scalar: ScalarSpace, chi: FloatArray, eta: float, solver: str, threads: int
    ) -> None:
        super().__init__(scalar, chi, eta, solver, threads)
        self._form.AssembleLinearization(self._u.vec)
        values = self._map @ self._form.mat.AsVector().FV().NumPy()
        self._mass = self._symmetric(values[self._lower_entries])
        table = self.void.table
        self._points = scalar.grid.mesh(table.x.ravel(), table.y.ravel())
        problem = scalar.grid.problem
        rho = 1 / (1 + np.exp(-np.clip(self._at_points, -200, 200)))
        self._stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
        grey = (self._at_points < 0) & (self._at_points > _VOID)
        self._regions = (self._at_points >= 0, grey, self._at_points <= _VOID)
        self._v = ng.GridFunction(self._u.space)
        self._flips = [self._flip(axis) for axis in (0, 1)]

    def _symmetric(self, lower_values: FloatArray) -> sp.csr_matrix:
        lower = sp.csr_matrix(
            (lower_values, self._lower.indices, self._lower.indptr), shape=self._lower.shape
        )
        return sp.csr_matrix(lower + sp.tril(lower, -1).T)

    def _flip(self, axis: int) -> Callable[[FloatArray], FloatArray]:
        """Mirror image of a field about x = L/2 (axis 0) or y = H/2 (axis 1)."""
        twin = self.scalar.opposite(np.arange(self.scalar.ndof), axis)

        def flip(field: FloatArray) -> FloatArray:
            components = field.reshape(2, -1)[:, twin].copy()
            components[axis] *= -1
            return components.ravel()

        return flip

    def lowest(
        self, d: float, u: FloatArray, count: int
    ) -> tuple[FloatArray, FloatArray, int | None]:
        """Lowest eigenvalues of the tangent at a state.

        Returns
        -------
        eigenvalues : array (k,)
            Increasing.
        vectors : array (free, k)
            With ``v.M v = 1``.
        negative : int or None
            Number of negative eigenvalues of the whole tangent, if the solver tells.

        Raises
        ------
        ConvergenceError
            If the tangent is not finite or the eigenvalues do not converge.
        """
        self.assemble(d, u)
        assert self._factorization is not None
        negative = self._factorization.negative_eigenvalues
        tangent = self._symmetric(self._lower.data)
        parts = [("LA", count), ("SA", min(negative, _MOST_NEGATIVE))] if negative else [("LM", count)]
        solve = LinearOperator(tangent.shape, matvec=self.solve_linear, dtype=float)
        start = np.random.default_rng(0).uniform(-1, 1, self.free)
        values, vectors = [], []
        for which, k in parts:
            try:
                # Of 1/lambda: LM those next to zero, LA the positive and SA the negative ones.
                w, v = eigsh(
                    tangent, k, self._mass, sigma=0.0, which=which, OPinv=solve, v0=start,
                    tol=1e-6, ncv=max(40, 2 * k + 10),
                )
            except ArpackNoConvergence as error:
                raise ConvergenceError(f"the eigenvalues at d = {d:g} mm: {error}") from None
            values.append(w)
            vectors.append(v)
        value, vector = np.concatenate(values), np.hstack(vectors)
        order = np.argsort(value)
        return value[order], vector[:, order], negative
