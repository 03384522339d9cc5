"""Equilibrium of a solid with contact at a prescribed displacement.

A minimum of the total energy, strain energy plus contact: Newton's method with the exact second
derivative, steps limited by `ngspring.solid.contact.tunnelling.Skeleton` and by a line search on
the energy, and a shift of the matrix where it is not positive definite, so that each step goes
downhill. While steps with the same factors still bring forces down well, they are used again: a
new tangent costs as much as four evaluations of the forces.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ngspring.analysis.newton import NewtonError, Step, downhill, newton
from ngspring.analysis.path import Steps, departure, extrapolated, stepped
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.solid.contact.contact import Contact, ContactState
from ngspring.solid.contact.elasticity import Solid
from ngspring.solid.contact.factors import Factors, Tangent
from ngspring.solid.contact.tunnelling import Skeleton

logger = logging.getLogger(__name__)

#: Softer laws on the way, from what overlap on (in units of epsilon), and their accuracy.
_SOFTER = (400.0, 20.0)
_DEEP = 4.0
#: Surfaces touch from what overlap on, in the same units.
_PRESSED = 1e-6
_ROUGH = 1e-4
#: Shorter steps with one of them say that it is too soft to keep surfaces apart.
_SHORT = 1e-2
#: Where contact leaves no more than this part of a step, the softer laws are asked what touches.
_CUT = 0.01

_PREDICTIONS = 8
#: The last factors serve again after a step that left no more than this part of the forces.
_EASY = 0.1
#: No Newton step is longer than this, in sizes of the body.
_FAR = 100.0
#: Up to this `departure` of two points of a path the next one is guessed by a cubic, and looked for
#: with the factors of the last one.
_SMOOTH, _STRAIGHT = 5e-3, 1e-3
#: A prediction that moves a point by more than this many times the step is that of a tangent which
#: is nearly singular: it says nothing.
_WILD = 100.0


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
        Tangents that it took.
    before : ContactPoint, optional
        The point before on the same path, without what was before it.
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
    before: ContactPoint | None = None


class _BlockedError(Exception):
    """Contact that closed on the way of a Newton step left little of it.

    Attributes
    ----------
    u : array (free,)
        The unknowns that were reached.
    made : int
        Tangents made.
    """

    def __init__(self, u: FloatArray, made: int) -> None:
        super().__init__("a Newton step is cut short by contact")
        self.u, self.made = u, made


class _State:
    """Forces, and the energy where it is asked for, at some displacements."""

    def __init__(
        self, solid: Solid, law: Contact, u: FloatArray, full: FloatArray, ahead: bool
    ) -> None:
        self._solid, self._law = solid, law
        self.u, self.full = u, full
        self.contact: ContactState = law.state(full, ahead)
        forces = solid.forces(full) + law.forces(self.contact)
        self.force = np.asarray(solid.transposed @ forces)

    @cached_property
    def energy(self) -> float:
        """Strain and contact energy in N mm."""
        return self._solid.energy(self.full) + self._law.energy(self.contact)

    @property
    def imbalance(self) -> float:
        """Norm of the forces on the free unknowns in N."""
        return float(np.linalg.norm(self.force[:-1]))

    @property
    def admissible(self) -> bool:
        """Whether no element is inverted at an integration point."""
        return bool(np.isfinite(self.force).all())


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

    #: Most iterations of a step along the path, and of one so short that where it ends is where the
    #: body goes, through a snap. Where 60 are not enough a shorter step takes a few.
    MAX_ITERATIONS, PATIENCE = 30, 60
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
        self._rounding = 1e-16 * float(solid.diagonal_at_rest.max(initial=0.0)) * size**2
        self._factors = Factors(solid, solver, threads)
        #: Unknowns and tangent of the last equilibrium, and the unknowns the factors belong to.
        self._last: tuple[FloatArray, Tangent] | None = None
        self._factorized: FloatArray | None = None

    def full_field(self, d: float, u: FloatArray) -> FloatArray:
        """Dofs of the VectorH1 space."""
        return np.asarray(self.solid.matrix @ np.append(u, d))

    def _state(
        self, d: float, u: FloatArray, law: Contact | None = None, ahead: bool = False
    ) -> _State:
        law = self.contact if law is None else law
        return _State(self.solid, law, u, self.full_field(d, u), ahead)

    def _tangent(self, state: _State, law: Contact | None = None) -> Tangent:
        stiffness = self.solid.tangent_values(state.full)
        if not np.isfinite(stiffness).all():
            raise ConvergenceError("the tangent has entries that are not finite")
        law = self.contact if law is None else law
        return Tangent(stiffness, law.second_derivative(state.contact, self.solid.matrix))

    def _factorize(
        self, tangent: Tangent, shift: float = 0.0, more: sp.csr_matrix | None = None
    ) -> int:
        self._factorized = None
        return self._factors.factorize(tangent, shift, more)

    def _direction(self, tangent: Tangent, force: FloatArray) -> tuple[FloatArray, float]:
        """A downhill Newton step, and the shift that it took."""
        shift = 0.0
        while True:
            negative = self._factorize(tangent, shift)
            update = self._factors.roughly(-force)
            # Much further than the body is large is a tangent that is singular but for rounding.
            near = float(np.abs(update).max(initial=0.0)) <= _FAR * self.size
            if not negative and near and update @ force <= 0.0:
                return update, shift
            shift = max(10 * shift, 1e-5)
            if shift > 1e4:
                raise ConvergenceError("no downhill direction was found")

    def equilibrium(
        self, d: float, guess: FloatArray, again: bool = False, most: int = PATIENCE
    ) -> ContactPoint:
        """Minimum of the energy at a prescribed d, from an admissible guess.

        Where surfaces overlap in the guess more than they will in equilibrium, or close on the way
        as nobody foresaw, softer contact laws first find out what touches: with the stiff one,
        points would bounce. The last factors are tried ``again`` first, and there are at ``most``
        so many iterations with each law.

        Raises
        ------
        ConvergenceError
            If it is not found.
        """
        u, made = guess, 0
        state = self._state(d, u)
        if not state.admissible:
            raise ConvergenceError("the initial guess inverts an element")
        known = state.contact.smallest_gap >= -_DEEP * self.contact.law.epsilon
        hasty = known
        while made <= most:
            try:
                if not known:
                    u, made = self._touched(d, u, made, most)
                    state, again, known = self._state(d, u), False, True
                u, state, more = self._minimise(
                    d, u, state, self.contact, self.ACCURACY, most, again=again, hasty=hasty
                )
            except _BlockedError as blocked:
                u, made, known, hasty = blocked.u, made + blocked.made, False, False
                continue
            made += more
            point, moved = self._finished(d, u, state, made)
            if moved <= 100 * self.ACCURACY * self.size:
                return point
            u, state, made, again = point.u, self._state(d, point.u), made + 1, True
        raise ConvergenceError("the unknowns move where forces are in balance")

    def _touched(self, d: float, u: FloatArray, made: int, most: int) -> tuple[FloatArray, int]:
        """Unknowns at which softer contact laws are in balance, and the tangents made in all.

        On a fine mesh the softest may be too soft to keep skeletons apart: then the next one is
        the first.
        """
        for factor in _SOFTER:
            softer = self.contact.with_law(self.contact.law.softened(factor))
            try:
                u, _, more = self._minimise(d, u, self._state(d, u, softer), softer, _ROUGH, most)
            except ConvergenceError as error:
                logger.debug("contact %g times softer: %s", factor, error)
                continue
            made += more
        return u, made

    def _minimise(
        self,
        d: float,
        u: FloatArray,
        state: _State,
        contact: Contact,
        accuracy: float,
        most: int,
        *,
        again: bool = False,
        hasty: bool = False,
    ) -> tuple[FloatArray, _State, int]:
        """Newton's method until forces and updates are small; returns u and the tangents made.

        With the exact law, whoever goes on from there (`_finished`) looks at the update. In haste
        it is `_BlockedError` by contact that cuts a step to a small part.
        """
        shift, made, left = 0.0, 0, 0.0 if again else 1.0
        exact = contact is self.contact

        def direction(u: FloatArray, state: _State) -> FloatArray:
            nonlocal shift, made
            if left <= _EASY:
                return self._factors.roughly(-state.force[:-1])
            made += 1
            update, shift = self._direction(self._tangent(state, contact), state.force[:-1])
            return update

        def longest(u: FloatArray, update: FloatArray) -> float:
            way, blocked = self._free_way(self.full_field(d, u), self.full_field(d, u + update))
            return 0.9 * way if blocked else way

        def balanced(state: _State) -> bool:
            return state.imbalance <= self._tolerance(state, accuracy)

        def acceptable(step: Step[_State]) -> bool:
            before, after = step.before, step.after
            if not after.admissible:
                return False
            if shift == 0.0 and after.imbalance <= _EASY * before.imbalance:
                return True
            slopes = [float(step.update @ state.force[:-1]) for state in (before, after)]
            # Rounding of the energy must not stop the last steps.
            rounding = 1e-12 * abs(before.energy) + self._rounding
            energies = before.energy, after.energy
            return downhill(step.length, energies, slopes, rounding, balanced(after))

        norm = np.inf

        def converged(step: Step[_State]) -> bool:
            nonlocal left, norm
            norm = step.after.imbalance
            if hasty and step.length < _CUT:
                raise _BlockedError(step.after.u, made)
            whole = step.length == 1.0 and shift == 0.0
            left = norm / max(step.before.imbalance, 1e-300) if whole else 1.0
            small = exact or step.size <= 100 * accuracy * self.size
            return whole and small and balanced(step.after)

        try:
            u, state, _ = newton(
                u,
                state,
                evaluate=lambda u: self._state(d, u, contact),
                direction=direction,
                acceptable=acceptable,
                converged=converged,
                max_iterations=most,
                smallest=1e-8 if exact else _SHORT,
                longest=longest,
                stuck="the energy has no lower state along a Newton step",
                blocked="a wall is in the way of every Newton step",
            )
        except NewtonError as error:
            raise ConvergenceError(f"{error} (forces out of balance by {norm:.2g} N)") from None
        return u, state, made

    def _tolerance(self, state: _State, accuracy: float) -> float:
        """Norm of the forces in N that counts as balanced."""
        return accuracy * (self._small + abs(float(state.force[-1])))

    def _finished(
        self, d: float, u: FloatArray, state: _State, iterations: int
    ) -> tuple[ContactPoint, float]:
        """One more Newton step, to rounding, the tangent of the path, and how far u has moved."""
        matrix = self._tangent(state)
        column, corner = matrix.of_d(self.solid.pattern)
        if self._factorize(matrix):
            raise ConvergenceError("the equilibrium is not stable")
        update = -self._factors.solve(state.force[:-1])
        u = u + update
        state = self._state(d, u, ahead=True)
        tangent = -self._factors.solve(column)
        self._last, self._factorized = (u, matrix), u
        point = ContactPoint(
            d=d,
            u=u,
            # What is left out of balance belongs to q, weighted by du/dd.
            q=float(state.force[-1] + tangent @ state.force[:-1]),
            tangent=tangent,
            stiffness=corner + float(column @ tangent),
            energy=state.energy,
            contact=state.contact,
            residual=state.imbalance,
            iterations=iterations,
        )
        return point, float(np.abs(update).max(initial=0.0))

    def _tangent_at(self, here: ContactPoint) -> Tangent:
        """The tangent of an equilibrium, which is often the last one that was found."""
        if self._last is None or self._last[0] is not here.u:
            self._last = here.u, self._tangent(self._state(here.d, here.u))
        return self._last[1]

    def touching(self, point: ContactPoint) -> bool:
        """Whether surfaces press on each other.

        By more than rounding: in a crease two edges share a point, whose gap is zero.
        """
        return point.contact.smallest_gap < -_PRESSED * self.contact.law.epsilon

    def predicted(self, here: ContactPoint, d: float) -> FloatArray:
        """A guess for the free unknowns at d: along the path so far, contact ahead included.

        Where gaps of the present state would close on the way, they are held (nearly) closed, in
        linear theory, and the guess is found again until that set stays the same.
        """
        along = extrapolated(here.before, here, d, _SMOOTH) - here.u
        change, step = d - here.d, along
        gaps, rows, areas = self.contact.linear_gaps(here.contact, self.solid.matrix)
        n = self.solid.free
        rows, gaps = sp.csr_matrix(rows[:, :n]), gaps + change * rows[:, [n]].toarray().ravel()
        closing = gaps + rows @ step < 0.0
        if not closing.any():
            return here.u + step
        matrix = self._tangent_at(here)
        for _ in range(_PREDICTIONS):
            held = rows[closing]
            weight = self.contact.law.kappa * areas[closing]
            self._factorize(matrix, more=sp.csr_matrix(held.T @ sp.diags_array(weight) @ held))
            overlap = gaps[closing] + held @ along
            step = along - self._factors.solve(held.T @ (weight * overlap))
            before, closing = closing, gaps + rows @ step < 0.0
            if np.array_equal(before, closing):
                break
        return here.u + step

    def _is_straight(self, here: ContactPoint) -> bool:
        """Whether the factors are those of this point, and good enough for the next one."""
        if here.before is None or self._factorized is not here.u:
            return False
        return departure(here.before, here) <= _STRAIGHT

    def _free_way(self, begin: FloatArray, end: FloatArray) -> tuple[float, bool]:
        """Which part of the way between two fields can be gone, and whether a wall is in it.

        Not further than the body's size: beyond it collisions are all that there is, more than fit
        into memory. Newton's updates and predictions go there where a tangent is nearly singular.
        """
        part = min(1.0, self.size / max(float(np.abs(end - begin).max(initial=0.0)), 1e-300))
        free = self.skeleton.largest_step(begin, begin + part * (end - begin))
        return part * free, free < 1.0

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
            if np.abs(guess - here.u).max(initial=0.0) > _WILD * abs(d - here.d):
                guess = here.u
            end = self.full_field(d, guess)
            free_way, _ = self._free_way(begin, end)
            if free_way == 1.0 and not self.solid.inverted(end):
                resolved = tried <= self.steps.resolved * self.size
                most = self.PATIENCE if resolved else self.MAX_ITERATIONS
                there = self.equilibrium(d, guess, self._is_straight(here), most)
                there = replace(there, before=replace(here, before=None))
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
