"""Equilibrium of a given design (Eqs. 4 and 19 with chi frozen) along a path of displacements.

The same energy as in the coupled system. Equilibrium at a prescribed d is a root of the forces on
the free displacements; the reaction force q is the force on u_Ty, so ``q = dE/dd`` holds exactly
for the discrete energy E.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from ngspring.analysis.newton import Step, newton
from ngspring.analysis.path import Steps, extrapolated, stepped
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.fem.constraints import stretched
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.images import Image, Images, images
from ngspring.fem.linear import make_factorization, multiply, symmetric, wants_upper
from ngspring.fem.process import giving_memory_back, tasks
from ngspring.fem.reduction import (
    Pattern,
    csr_pattern,
    product_map,
    product_pattern,
    stored_values,
    united,
)
from ngspring.physics.chi import Field, stiffness
from ngspring.physics.elasticity import measure, strain_energy
from ngspring.physics.grey import grey_share
from ngspring.physics.offset import OffsetField
from ngspring.physics.pressure import PressureField
from ngspring.physics.void import VoidRegularisation, dx
from ngspring.problem.imperfection import Offset
from ngspring.problem.scaling import force_unit

#: Up to this `departure` two points are taken for neighbours on a smooth path.
_SMOOTH = 0.02


@dataclass(frozen=True)
class Equilibrium:
    """One point of a load path.

    Attributes
    ----------
    d : float
        Displacement of the top side in mm.
    u : array (free,)
        Free displacements in mm.
    q : float
        Reaction force in N.
    tangent : array (free,)
        du/dd, the predictor of the next point.
    stiffness : float
        dq/dd in N/mm.
    iterations : int
        Newton iterations.
    before : Equilibrium, optional
        The point before on the same path, without what was before it.
    """

    d: float
    u: FloatArray
    q: float
    tangent: FloatArray
    stiffness: float
    iterations: int
    before: Equilibrium | None = None

    def predicted(self, d: float) -> FloatArray:
        """Guess of the free displacements at another d of the path, see `extrapolated`."""
        return extrapolated(self.before, self, d, _SMOOTH)


class Mechanics:
    """Forces, tangent and equilibrium of a fixed design.

    Parameters
    ----------
    scalar : ScalarSpace
        Mesh and space; its grid's problem gives material and kinematics.
    chi : ngsolve.CoefficientFunction or array (ndof,)
        The design field: a formula, or H1 dofs.
    offset : float or Offset
        What is added to chi (2.6); with an imperfection two copies of a quarter are analysed, see
        `ngspring.fem.images`.
    solver, threads
        See `ngspring.fem.linear.make_factorization`.
    """

    MAX_ITERATIONS = 25
    #: How the step of a load path changes.
    steps = Steps(
        first=0.02,
        smallest=1e-4,
        largest=0.025,
        resolved=1e-3,
        smooth=0.1,
        lands=False,
        easy=4,
        hard=10,
        growth=2.0,
        remembered=True,
    )

    def __init__(
        self,
        scalar: ScalarSpace,
        chi: ng.CoefficientFunction | FloatArray,
        offset: float | Offset = 0.0,
        solver: str = "auto",
        threads: int = 1,
    ) -> None:
        self.scalar = scalar
        grid: Grid = scalar.grid
        problem = grid.problem
        self.problem = problem
        self.force_unit = force_unit(problem)
        offset = Offset(offset) if not isinstance(offset, Offset) else offset
        self.odd_in = offset.odd_in if offset.odd else ""
        self.images: Images = images(scalar, self.odd_in)
        self.free = self.images.free
        self.void = VoidRegularisation(scalar)
        self._pressure = PressureField.where_needed(scalar, self.void.table)
        self._field = ng.GridFunction(scalar.space)
        self._offset = OffsetField(problem, [self.odd_in] if self.odd_in else [])
        table = self.void.table
        if isinstance(chi, np.ndarray):
            field: ng.CoefficientFunction = self._field
            self._field.vec.FV().NumPy()[:] = chi
            at_points = self.void.chi_at_points(chi)
        else:
            field = chi
            points = grid.mesh(table.x.ravel(), table.y.ravel())
            at_points = np.asarray(chi(points)).reshape(table.x.shape)
        space = ng.VectorH1(grid.mesh, order=2)
        u = space.TrialFunction()
        energy = strain_energy(u, ng.Grad(u), problem)
        #: The design field with its offset, as an expression of NGSolve.
        self.chi = field + self._offset.value
        scaled = stiffness(self.chi, problem) * energy
        self._form = ng.BilinearForm(space, symmetric=True)
        density = measure(problem) * scaled
        self._form += ng.Variation(density.Compile() * dx())
        self._u = ng.GridFunction(space)
        self._u.vec[:] = 0.0
        self._result = self._u.vec.CreateVector()
        with giving_memory_back():
            self._prepare(solver, threads)
        self._set_points(at_points, offset)

    def _prepare(self, solver: str, threads: int) -> None:
        """Index maps from NGSolve's values to the tangent on the independent displacements."""
        with tasks():
            self._form.AssembleLinearization(self._u.vec)
        rows, columns = csr_pattern(self._form)
        matrices = [copy.matrix for copy in self.images.copies]
        pattern = united(product_pattern(rows, columns, P, P) for P in matrices)
        self._maps = [product_map(rows, columns, P, P, pattern) for P in matrices]
        n = self.scalar.ndof
        r, c = self.void.table.pairs
        both = np.concatenate([r, r + n]), np.concatenate([c, c + n])
        self._void_maps = [product_map(*both, P, P, pattern) for P in matrices]
        if self._pressure is not None:
            of_pressure = self._pressure.places
            self._pressure_maps = [product_map(*of_pressure, P, P, pattern) for P in matrices]
        rows, columns = pattern.rows, pattern.columns
        if wants_upper(solver):
            rows, columns = columns, rows
        #: where the values of the factorised triangle are in those of the whole
        self._inner_entries = np.flatnonzero((rows < self.free) & (columns <= rows))
        keys = pattern.keys[self._inner_entries]
        inner = Pattern(keys - keys // pattern.shape[1], (self.free, self.free))
        triangle = inner.matrix(np.ones(len(keys)))
        self._diagonal = np.flatnonzero(inner.rows == inner.columns)
        self._factorization = make_factorization(triangle, solver, threads)
        self._top_entries = np.flatnonzero(
            (pattern.rows < self.free) & (pattern.columns == self.free)
        )
        self._top_rows = pattern.rows[self._top_entries]
        self._corner = int(np.searchsorted(pattern.keys, pattern.shape[0] * pattern.shape[1] - 1))

    def _set_points(self, chi_at_points: FloatArray, offset: Offset) -> None:
        table, problem = self.void.table, self.problem
        self._offsets = self.images.offsets(offset)
        self._offset.set(self._offsets[0])
        self._at_points: list[FloatArray] = [
            chi_at_points + of_copy.at(table.x, table.y, problem.L, problem.H)
            for of_copy in self._offsets
        ]
        self._constant: FloatArray | None = None
        self._stiff_diagonal: FloatArray | None = None

    def _void_stiffness(self) -> FloatArray:
        """The void's part of the tangent, made when a tangent first needs it."""
        if self._constant is None:
            self._constant = np.zeros(self._maps[0].shape[0])
            for copy, at_points, void_map in zip(
                self.images.copies, self._at_points, self._void_maps, strict=True
            ):
                element = self.void.stiffness(at_points).ravel()
                self._constant += copy.share * (void_map @ np.concatenate([element, element]))
        return self._constant

    def _load(self, k: int, field: FloatArray) -> Image:
        """Give the form the displacements and the offset of a copy."""
        self._u.vec.FV().NumPy()[:] = field
        if len(self.images.copies) > 1:
            self._offset.set(self._offsets[k])
        return self.images.copies[k]

    def _stiffness(self, fields: list[FloatArray]) -> FloatArray:
        """Values of the tangent, both triangles, at a state of the copies."""
        values: FloatArray = self._void_stiffness().copy()
        for k, field in enumerate(fields):
            copy = self._load(k, field)
            with tasks():
                self._form.AssembleLinearization(self._u.vec)
            values += copy.share * (self._maps[k] @ stored_values(self._form))
            if self._pressure is not None:
                element = self._pressure.stiffness(self._at_points[k], field)
                values += copy.share * (self._pressure_maps[k] @ element.ravel())
        return values

    def set_design(self, chi: FloatArray, offset: Offset) -> None:
        """Replace the design (H1 dofs) and its offset; only if it was given as dofs before.

        The new offset is of the same kind as the one before.
        """
        self._field.vec.FV().NumPy()[:] = chi
        self._set_points(self.void.chi_at_points(chi), offset)

    @property
    def size(self) -> float:
        """H in mm, which steps and updates are measured with."""
        return self.problem.H

    def fields(self, d: float, u: FloatArray) -> list[FloatArray]:
        """Dofs of the VectorH1 space (x component first) of every copy."""
        return self.images.fields(np.append(u, d))

    def full_field(self, d: float, u: FloatArray) -> FloatArray:
        """Those of the first copy: all there is without an imperfection."""
        return self.fields(d, u)[0]

    def energy(self, d: float, u: FloatArray) -> float:
        """Strain energy E of the whole spring in N mm (with the void's)."""
        energy = 0.0
        for k, field in enumerate(self.fields(d, u)):
            copy = self._load(k, field)
            with tasks():
                of_law = float(self._form.Energy(self._u.vec))
            of_void = 0.5 * float(field @ self.void.forces(self._at_points[k], field))
            energy += copy.share * (of_law + of_void)
            if self._pressure is not None:
                energy += copy.share * self._pressure.energy(self._at_points[k], field)
        return energy

    def grey_share(self, d: float, u: FloatArray) -> float:
        """Share of the strain energy in material that is neither solid nor void."""
        self._load(0, self.full_field(d, u))
        mesh = self.scalar.grid.mesh
        return grey_share(self.chi, self._u, mesh, self.problem)

    def forces(self, d: float, u: FloatArray) -> FloatArray:
        """dE/d(u, d): forces on the free displacements, and q as the last entry."""
        forces = []
        for k, field in enumerate(self.fields(d, u)):
            self._load(k, field)
            with tasks():
                self._form.Apply(self._u.vec, self._result)
            total = self._result.FV().NumPy() + self.void.forces(self._at_points[k], field)
            if self._pressure is not None:
                total = total + self._pressure.forces(self._at_points[k], field)
            forces.append(total)
        return self.images.reduced(forces)

    def assemble(self, d: float, u: FloatArray, shift: float = 0.0) -> tuple[FloatArray, float]:
        """Assemble and factorise the tangent; returns its column of u_Ty and their corner.

        ``shift`` times the diagonal of the undeformed tangent is added for `settle`.

        Raises
        ------
        ConvergenceError
            If an entry is not finite or the factorisation fails.
        """
        values = self._stiffness(self.fields(d, u))
        if not np.isfinite(values).all():
            raise ConvergenceError("the tangent has entries that are not finite")
        self._factorization.matrix.data[:] = values[self._inner_entries]
        if shift > 0.0:
            self._factorization.matrix.data[self._diagonal] += shift * self._diagonal_at_rest()
        try:
            self._factorization.factorize()
        except Exception as error:
            raise ConvergenceError(f"the factorisation failed: {error}") from error
        column = np.zeros(self.free)
        column[self._top_rows] = values[self._top_entries]
        return column, float(values[self._corner])

    @property
    def tangent(self) -> sp.csr_matrix:
        """The last assembled tangent on the free displacements, both triangles."""
        return symmetric(self._factorization.matrix)

    @property
    def negative_eigenvalues(self) -> int | None:
        """How many eigenvalues of the last tangent are negative; None if the solver cannot tell."""
        return self._factorization.negative_eigenvalues

    @property
    def chi_at_points(self) -> FloatArray:
        """chi with its offset at the Gauss points, (elements, 9); of the first copy."""
        return self._at_points[0]

    def faded_stiffness_at_rest(self, factor: Callable[[Field], Field]) -> sp.csr_matrix:
        """Second derivative of the strain energy times a factor, without the void's, at rest.

        Of a design without an imperfection.

        Parameters
        ----------
        factor : callable
            From chi + eta, an expression of NGSolve or an array.

        Returns
        -------
        scipy.sparse.csr_matrix (free, free)
            Both triangles.
        """
        space = self._u.space
        u = space.TrialFunction()
        form = ng.BilinearForm(space, symmetric=True)
        problem = self.problem
        scaled = measure(problem) * factor(self.chi) * stiffness(self.chi, problem)
        density = scaled * strain_energy(u, ng.Grad(u), problem)
        form += ng.Variation(density.Compile() * dx())
        self._u.vec[:] = 0.0
        with tasks():
            form.AssembleLinearization(self._u.vec)
        values = self._maps[0] @ stored_values(form)
        if self._pressure is not None:
            at_points, rest = self._at_points[0], np.zeros(2 * self.scalar.ndof)
            element = self._pressure.stiffness(at_points, rest, factor(at_points))
            values = values + self._pressure_maps[0] @ element.ravel()
        triangle = self._factorization.matrix.copy()
        triangle.data = values[self._inner_entries]
        return symmetric(triangle)

    def _diagonal_at_rest(self) -> FloatArray:
        if self._stiff_diagonal is None:
            values = self._stiffness(self.fields(0.0, np.zeros(self.free)))
            self._stiff_diagonal = values[self._inner_entries[self._diagonal]]
        return self._stiff_diagonal

    def settle(
        self, d: float, u: FloatArray, accuracy: float, max_iterations: int = 100
    ) -> tuple[FloatArray, FloatArray]:
        """Go downhill in the strain energy to a stable equilibrium at a prescribed d.

        Where a branch of equilibria ends (a crease or a piece of the void snaps through), no
        Newton iteration can follow it: the spring jumps. This is where it lands, by Newton steps
        with as large a shift of the tangent as it takes to lower the energy.

        Parameters
        ----------
        d : float
        u : array (free,)
            An admissible state.
        accuracy : float
            Norm of the forces in N that counts as balanced.
        max_iterations : int

        Returns
        -------
        u, tangent : arrays
            Equilibrium and du/dd.

        Raises
        ------
        ConvergenceError
            If none is found.
        """
        shift = 1e-4
        energy, force = self.energy(d, u), self.forces(d, u)
        if not (np.isfinite(energy) and np.isfinite(force).all()):
            raise ConvergenceError("the state to settle from inverts an element")
        for _ in range(max_iterations):
            column, _ = self.assemble(d, u, shift)
            negative = self._factorization.negative_eigenvalues
            balanced = np.linalg.norm(force[:-1]) <= accuracy
            if balanced and shift == 0.0 and not negative:
                return u, -self.solve_linear(column)
            update = self.solve_linear(-force[:-1])
            trial = u + update
            trial_force = self.forces(d, trial)
            trial_energy = self.energy(d, trial)
            # Rounding of the energy must not stop the last steps.
            lower = trial_energy <= energy + 1e-12 * abs(energy)
            if np.isfinite(trial_force).all() and lower and not negative:
                u, force, energy = trial, trial_force, trial_energy
                shift = shift / 5 if shift > 1e-9 else 0.0
                continue
            if shift > 1e4:
                break
            shift = max(10 * shift, 1e-8)
        raise ConvergenceError("no stable equilibrium was found")

    def solve_linear(self, rhs: FloatArray) -> FloatArray:
        """Solution with the last tangent, refined once."""
        x = self._factorization.solve(rhs)
        return x + self._factorization.solve(rhs - multiply(self._factorization.matrix, x))

    def adjoint(
        self, point: Equilibrium, lam_top: float, load: FloatArray | None = None
    ) -> FloatArray:
        """lam with ``K lam = -load`` and the given value on the top (Eq. 7).

        Without a load it is du/dd times that value.

        Parameters
        ----------
        point : Equilibrium
            The one whose tangent was assembled last.
        lam_top : float
            ``w (q - q_*)`` in N^-1.
        load : array (free + 1,), optional
            Derivative by u of the terms of the objective that depend on displacements.
        """
        lam = point.tangent * lam_top
        if load is not None:
            lam = lam - self.solve_linear(load[:-1])
        return np.append(lam, lam_top)

    def equilibrium(self, d: float, *guesses: FloatArray) -> Equilibrium:
        """Newton's method at a prescribed d, from the first guess that inverts no element.

        Steps that would invert an element (a non-finite residual) are halved.

        Raises
        ------
        ConvergenceError
            If it does not converge.
        """
        for guess in guesses:
            force = self.forces(d, guess)
            if np.isfinite(force).all():
                break
        else:
            raise ConvergenceError("the initial guess inverts an element")
        first = np.linalg.norm(force[:-1])
        tangents: list[tuple[FloatArray, float]] = []

        def direction(u: FloatArray, force: FloatArray) -> FloatArray:
            tangents[:] = [self.assemble(d, u)]
            return self._factorization.solve(-force[:-1])

        def converged(step: Step[FloatArray]) -> bool:
            force = step.after
            norm = np.linalg.norm(force[:-1])
            if step.size > 1e3 * self.size or norm > 1e8 * (first + self.force_unit):
                raise ConvergenceError("Newton's method diverges")
            # Quadratic convergence: after an update of 1e-7 the next one would be rounding.
            small = step.length == 1.0 and step.size <= 1e-7 * self.size
            return bool(small and norm <= 1e-9 * (1e-3 * self.force_unit + abs(force[-1])))

        u, force, iterations = newton(
            guess,
            force,
            evaluate=lambda u: self.forces(d, u),
            direction=direction,
            acceptable=lambda step: bool(np.isfinite(step.after).all()),
            converged=converged,
            max_iterations=self.MAX_ITERATIONS,
        )
        # The last tangent is that of a state closer than can be told: it serves once more.
        column, corner = tangents[-1]
        u = u - self.solve_linear(force[:-1])
        q = float(self.forces(d, u)[-1])
        tangent = -self.solve_linear(column)
        return Equilibrium(d, u, q, tangent, corner + float(column @ tangent), iterations)

    def newton_update(
        self, d: float, u: FloatArray, force: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Newton's update of u where the forces are these, and the tangent's column of u_Ty."""
        column, _ = self.assemble(d, u)
        return self.solve_linear(-force[:-1]), column

    def advanced(self, here: Equilibrium, target: float, tried: float) -> tuple[Equilibrium, float]:
        """The equilibrium ``tried`` mm on towards a target, see `ngspring.analysis.path`."""
        d = stepped(here.d, target, tried)
        along_tangent = here.u + (d - here.d) * here.tangent
        there = self.equilibrium(d, here.predicted(d), along_tangent)
        return replace(there, before=replace(here, before=None)), tried

    def settled(self, here: Equilibrium, target: float, tried: float) -> Equilibrium:
        """Where the spring jumps if the branch ends here, see `settle`."""
        d = stepped(here.d, target, tried)
        u, _ = self.settle(d, here.u, 1e-7 * (1e-3 * self.force_unit + abs(here.q)))
        return self.equilibrium(d, u)

    def refined(self, point: Equilibrium) -> Equilibrium:
        """The same equilibrium and its tangent to rounding.

        q - q_* is a millionth of q at an optimum, and the adjoint state is this tangent times it:
        what is good enough to follow a path is too rough to judge stationarity.
        """
        d, u = point.d, point.u
        self.assemble(d, u)
        u = u - self.solve_linear(self.forces(d, u)[:-1])
        column, corner = self.assemble(d, u)
        u = u - self.solve_linear(self.forces(d, u)[:-1])
        tangent = -self.solve_linear(column)
        # u itself is rounded: what that leaves out of balance belongs to q, weighted by du/dd.
        force = self.forces(d, u)
        q = float(force[-1] + tangent @ force[:-1])
        stiffness = corner + float(column @ tangent)
        return Equilibrium(d, u, q, tangent, stiffness, point.iterations + 2)

    def at_rest(self) -> Equilibrium:
        """The undeformed state, d = 0."""
        return self.equilibrium(0.0, np.zeros(self.free))

    def uniform_stretch(self, d: float) -> FloatArray:
        """Free displacements of u = (0, y d / H)."""
        return d * self.images.restrict(stretched(self.scalar))
