"""Equilibrium of a solid with contact at a prescribed displacement.

A minimum of the total energy, strain energy plus contact: Newton's method with the exact second
derivative, steps limited by `ngspring.solid.contact.tunnelling.Skeleton` and by a line search on
the energy, and a shift of the matrix where it is not positive definite, so that each step goes
downhill.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ngspring.analysis.newton import NewtonError, Step, newton
from ngspring.analysis.path import Steps, stepped
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.fem.linear import (
    Factorization,
    inertia,
    make_factorization,
    multiply,
    symmetric,
    wants_upper,
)
from ngspring.solid.contact.contact import Contact, ContactState
from ngspring.solid.contact.elasticity import Solid
from ngspring.solid.contact.tunnelling import Skeleton

logger = logging.getLogger(__name__)

#: Softer laws on the way, from what overlap on (in units of epsilon), and their accuracy.
_SOFTER = (400.0, 20.0)
_DEEP = 4.0
_ROUGH = 1e-4
_PREDICTIONS = 8
#: Stiffness of the spring that holds a floating part in the linear systems, as a share of the
#: diagonal: far below that of a contact that begins, which alone may hold the part.
_HOLD = 1e-6


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One point of a load path with contact.

    Attributes
    ----------
    d : float
        Prescribed displacement in mm.
    u : array (free,)
        Free unknowns in mm.
    q : float
        dE/dd in N.
    tangent : array (free,)
        du/dd.
    stiffness : float
        dq/dd in N/mm.
    energy : float
        Strain and contact energy in N mm.
    contact : ContactState
        What touches what.
    residual : float
        Norm of the forces on the free unknowns in N.
    iterations : int
    """

    d: float
    u: FloatArray
    q: float
    tangent: FloatArray
    stiffness: float
    energy: float
    contact: ContactState
    residual: float
    iterations: int


@dataclass(frozen=True, eq=False)
class _State:
    full: FloatArray
    contact: ContactState
    energy: float
    force: FloatArray


class ContactMechanics:
    """Solid, contact and skeleton together.

    Parameters
    ----------
    solid : Solid
    contact : Contact
    skeleton : Skeleton
    size : float
        Length in mm against which updates are judged.
    force : float
        Force in N, a thousandth of which is taken for small.
    solver, threads
        See `ngspring.fem.linear.make_factorization`.
    """

    MAX_ITERATIONS = 60
    ACCURACY = 1e-9
    #: How the step of a load path changes.
    steps = Steps(
        first=0.01,
        smallest=1e-5,
        largest=0.025,
        resolved=5e-3,
        smooth=0.5,
        lands=True,
        easy=14,
        hard=24,
        growth=1.7,
        remembered=False,
    )

    def __init__(
        self,
        solid: Solid,
        contact: Contact,
        skeleton: Skeleton,
        size: float,
        force: float,
        solver: str = "auto",
        threads: int = 1,
    ) -> None:
        self.solid, self.contact, self.skeleton = solid, contact, skeleton
        self.size = size
        self._small = 1e-3 * force
        contact.leave_out_held(solid.matrix)
        self._solver, self._threads = solver, threads
        self._rounding = 1e-16 * float(solid.diagonal_at_rest.max(initial=0.0)) * size**2
        self._factorization: Factorization | None = None

    def full_field(self, d: float, u: FloatArray) -> FloatArray:
        """Dofs of the VectorH1 space."""
        return np.asarray(self.solid.matrix @ np.append(u, d))

    def _state(self, d: float, u: FloatArray, law: Contact | None = None) -> _State:
        law = self.contact if law is None else law
        full = self.full_field(d, u)
        contact = law.state(full)
        energy = self.solid.energy(full) + law.energy(contact)
        force = self.solid.transposed @ (self.solid.forces(full) + law.forces(contact))
        return _State(full, contact, energy, np.asarray(force))

    def _admissible(self, state: _State) -> bool:
        return bool(np.isfinite(state.energy) and np.isfinite(state.force).all())

    def _tangent(
        self, state: _State, law: Contact | None = None
    ) -> tuple[sp.csr_matrix, FloatArray, float]:
        """Matrix of the free unknowns, its column of d, and their corner."""
        stiffness = self.solid.tangent(state.full)
        if not np.isfinite(stiffness.data).all():
            raise ConvergenceError("the tangent has entries that are not finite")
        law = self.contact if law is None else law
        contact = law.second_derivative(state.contact, self.solid.matrix)
        total = sp.csr_matrix(stiffness + contact)
        n = self.solid.free
        column = np.asarray(total[:n, n].todense()).ravel()
        return sp.csr_matrix(total[:n, :n]), column, float(total[n, n])

    def _factorize(self, matrix: sp.csr_matrix, shift: float) -> int:
        """Factorise; returns how many eigenvalues are negative (0 if not known)."""
        extra = shift * self.solid.diagonal_at_rest
        floating = self.solid.floating
        extra[floating] += _HOLD * self.solid.diagonal_at_rest[floating]
        matrix = matrix + sp.diags_array(extra)
        triangle = sp.triu(matrix) if wants_upper(self._solver) else sp.tril(matrix)
        triangle = sp.csr_matrix(triangle)
        triangle.sort_indices()
        factorization = self._factorization
        if factorization is None:
            factorization = make_factorization(triangle, self._solver, self._threads)
            self._factorization = factorization
        elif not _same_pattern(factorization.matrix, triangle):
            # What touches what decides the pattern.
            factorization.set_pattern(triangle)
        factorization.matrix.data[:] = triangle.data
        try:
            factorization.factorize()
        except Exception as error:
            raise ConvergenceError(f"the factorisation failed: {error}") from error
        negative = factorization.negative_eigenvalues
        return (inertia(symmetric(triangle)) if negative is None else negative) or 0

    def _solve(self, rhs: FloatArray) -> FloatArray:
        """Solution with the last matrix, refined once."""
        assert self._factorization is not None
        x = self._factorization.solve(rhs)
        residual = rhs - multiply(self._factorization.matrix, x)
        return np.asarray(x + self._factorization.solve(residual))

    def _direction(self, matrix: sp.csr_matrix, force: FloatArray) -> tuple[FloatArray, float]:
        """A downhill Newton step, and the shift that it took."""
        shift = 0.0
        while True:
            negative = self._factorize(matrix, shift)
            update = self._solve(-force)
            if not negative and np.isfinite(update).all() and update @ force <= 0.0:
                return update, shift
            shift = max(10 * shift, 1e-5)
            if shift > 1e4:
                raise ConvergenceError("no downhill direction was found")

    def equilibrium(self, d: float, guess: FloatArray) -> ContactPoint:
        """Minimum of the energy at a prescribed d, from an admissible guess.

        Where surfaces overlap in the guess more than they will in equilibrium, softer contact laws
        first find out what touches: with the stiff one, points would bounce.

        Raises
        ------
        ConvergenceError
            If it is not found.
        """
        u, iterations = guess, 0
        state = self._state(d, u)
        if not self._admissible(state):
            raise ConvergenceError("the initial guess inverts an element")
        contact = self.contact
        if state.contact.smallest_gap < -_DEEP * contact.law.epsilon:
            for factor in _SOFTER:
                softer = contact.with_law(contact.law.softened(factor))
                u, made = self._minimise(d, u, softer, _ROUGH)
                iterations += made
        u, made = self._minimise(d, u, contact, self.ACCURACY)
        return self._finished(d, u, iterations + made)

    def _minimise(
        self, d: float, u: FloatArray, contact: Contact, accuracy: float
    ) -> tuple[FloatArray, int]:
        """Newton's method until forces and updates are small; returns u and the iterations."""
        shift = [0.0]

        def direction(u: FloatArray, state: _State) -> FloatArray:
            matrix, _, _ = self._tangent(state, contact)
            update, shift[0] = self._direction(matrix, state.force[:-1])
            return update

        def longest(u: FloatArray, update: FloatArray) -> float:
            begin, end = self.full_field(d, u), self.full_field(d, u + update)
            free_way = self.skeleton.largest_step(begin, end)
            return 1.0 if free_way == 1.0 else 0.9 * free_way

        def acceptable(step: Step[_State]) -> bool:
            before, after = step.before, step.after
            slope = float(step.update @ before.force[:-1])
            # Rounding of the energy must not stop the last steps.
            rounding = 1e-12 * abs(before.energy) + self._rounding
            bound = before.energy + 1e-4 * step.length * slope + rounding
            return self._admissible(after) and after.energy <= bound

        norm = np.inf

        def converged(step: Step[_State]) -> bool:
            nonlocal norm
            force = step.after.force
            norm = float(np.linalg.norm(force[:-1]))
            small = step.length == 1.0 and step.size <= 100 * accuracy * self.size
            return small and shift[0] == 0.0 and norm <= accuracy * (self._small + abs(force[-1]))

        try:
            u, _, iterations = newton(
                u,
                self._state(d, u, contact),
                evaluate=lambda u: self._state(d, u, contact),
                direction=direction,
                acceptable=acceptable,
                converged=converged,
                max_iterations=self.MAX_ITERATIONS,
                smallest=1e-8,
                longest=longest,
                stuck="the energy has no lower state along a Newton step",
            )
        except NewtonError as error:
            raise ConvergenceError(f"{error} (forces out of balance by {norm:.2g} N)") from None
        return u, iterations

    def _finished(self, d: float, u: FloatArray, iterations: int) -> ContactPoint:
        """One more Newton step, to rounding, and the tangent of the path."""
        state = self._state(d, u)
        matrix, column, corner = self._tangent(state)
        if self._factorize(matrix, 0.0):
            raise ConvergenceError("the equilibrium is not stable")
        u = u - self._solve(state.force[:-1])
        state = self._state(d, u)
        tangent = -self._solve(column)
        return ContactPoint(
            d=d,
            u=u,
            # What is left out of balance belongs to q, weighted by du/dd.
            q=float(state.force[-1] + tangent @ state.force[:-1]),
            tangent=tangent,
            stiffness=corner + float(column @ tangent),
            energy=state.energy,
            contact=state.contact,
            residual=float(np.linalg.norm(state.force[:-1])),
            iterations=iterations,
        )

    def predicted(self, here: ContactPoint, d: float) -> FloatArray:
        """A guess for the free unknowns at d: the tangent of the path, contact ahead included.

        Where gaps of the present state would close on the tangent, they are held (nearly) closed,
        in linear theory, and the tangent is found again until that set stays the same.
        """
        change = d - here.d
        step = change * here.tangent
        gaps, rows, areas = self.contact.linear_gaps(here.contact, self.solid.matrix)
        n = self.solid.free
        rows, gaps = sp.csr_matrix(rows[:, :n]), gaps + change * rows[:, [n]].toarray().ravel()
        closing = gaps + rows @ step < 0.0
        if not closing.any():
            return here.u + step
        state = self._state(here.d, here.u)
        matrix, column, _ = self._tangent(state)
        for _ in range(_PREDICTIONS):
            held = rows[closing]
            weight = self.contact.law.kappa * areas[closing]
            self._factorize(sp.csr_matrix(matrix + held.T @ sp.diags_array(weight) @ held), 0.0)
            step = self._solve(-change * column - held.T @ (weight * gaps[closing]))
            before, closing = closing, gaps + rows @ step < 0.0
            if np.array_equal(before, closing):
                break
        return here.u + step

    def advanced(
        self, here: ContactPoint, target: float, tried: float
    ) -> tuple[ContactPoint, float]:
        """The equilibrium ``tried`` mm on towards a target, see `ngspring.analysis.path`.

        The step is shortened where a wall would jump through another.
        """
        begin = self.full_field(here.d, here.u)
        while True:
            d = stepped(here.d, target, tried)
            guess = self.predicted(here, d)
            end = self.full_field(d, guess)
            free_way = self.skeleton.largest_step(begin, end)
            if free_way == 1.0 and not self.solid.inverted(end):
                there = self.equilibrium(d, guess)
                gap = there.contact.smallest_gap
                log = "d = %.6g mm: q = %.8g N, %d iterations, gap %.3g mm"
                logger.info(log, there.d, there.q, there.iterations, gap)
                return there, tried
            tried *= 0.5 if free_way == 1.0 else max(0.8 * free_way, 0.1)
            if tried < 0.1 * self.steps.smallest * self.size:
                raise ConvergenceError("every step would carry a wall through another")

    def settled(self, here: ContactPoint, target: float, tried: float) -> ContactPoint:
        """A solid is not followed where no equilibrium is found."""
        raise ConvergenceError("the branch ends")

    def at_rest(self) -> ContactPoint:
        """The undeformed state."""
        return self.equilibrium(0.0, np.zeros(self.solid.free))


def _same_pattern(a: sp.csr_matrix, b: sp.csr_matrix) -> bool:
    return (
        len(a.indices) == len(b.indices)
        and np.array_equal(a.indptr, b.indptr)
        and np.array_equal(a.indices, b.indices)
    )
