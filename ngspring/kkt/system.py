"""The coupled Newton system of Eqs. 4, 7 and 8 on the independent unknowns.

Unknowns are the spline coefficients of chi, and for each control point the free displacements u
and multipliers lam (with lam_Ty last, which stands for q, see `State`). Each control point couples
to chi only, so the matrix is arrow-shaped. With ``u = a + b``, ``lam = s (a - b)`` the blocks of
a control point, ``[[B, K], [K, 0]]``, become ``[[B + 2 s K, B], [B, B - 2 s K]]``: definite on
either side while K is, so that a symmetric factorisation needs no pivoting (design notes, 5).

A control point with an imperfection has about twice as many displacements, those of two copies of
the quarter (`ngspring.fem.images`), and the sum of their residuals and tangents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.images import Images, images
from ngspring.fem.linear import Factorization, make_factorization, multiply, wants_upper
from ngspring.fem.process import giving_memory_back
from ngspring.kkt.matrix import BlockMaps
from ngspring.kkt.state import State
from ngspring.kkt.timings import Timings, timed
from ngspring.physics.lagrangian import ControlPointForm, DesignForm
from ngspring.physics.terms import TERMS
from ngspring.physics.terms.base import Term
from ngspring.problem.imperfection import Offset
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import adjoint_unit, force_unit, length_unit
from ngspring.problem.spring import SpringProblem


class LinearSolveError(ArithmeticError):
    """A linear system could not be solved to a usable accuracy; the Newton step has failed."""


@dataclass
class Residual:
    """Left-hand sides of Eq. 8 (chi), Eq. 7 (adjoint, u) and Eq. 4 (equilibrium, lam).

    ``chi_terms`` holds the norms of the terms that make up ``chi``: what it is small against.
    """

    chi: FloatArray
    u: FloatArray
    lam: FloatArray
    chi_terms: dict[str, float]

    @property
    def finite(self) -> bool:
        """Whether no entry is NaN or infinite (an inverted element gives NaN)."""
        return all(bool(np.isfinite(a).all()) for a in (self.chi, self.u, self.lam))


class CoupledSystem:
    """Residual, exact tangent and solution of the coupled system.

    Parameters
    ----------
    problem : SpringProblem
    solver : str
        Linear solver, see `ngspring.fem.linear.make_factorization`.
    threads : int
        Threads of the factorisation; NGSolve's own are set by `ngspring.fem.process.parallel`.
    terms : sequence of Term
        The terms of the objective beside the control points'.
    timings : Timings, optional
        Where the seconds are added up; its own by default.
    """

    def __init__(
        self,
        problem: SpringProblem,
        solver: str = "auto",
        threads: int = 1,
        terms: Sequence[Term] = TERMS,
        timings: Timings | None = None,
    ) -> None:
        self.problem = problem
        self.points = problem.control_points
        self.solver = solver
        self.threads = threads
        self.timings = Timings() if timings is None else timings
        self._build(terms)
        self._chi_unit = 1.0
        self._scale = 1.0
        # What makes s the same in all units: u is a length, lam an inverse force.
        self._length_unit = length_unit(problem)
        self._lam_unit = 1 / force_unit(problem)
        self._top_unit = adjoint_unit(problem)
        self._maps: BlockMaps | None = None
        self._factorization: Factorization | None = None
        self.retarget(self.points)

    @timed("preparation")
    def _build(self, terms: Sequence[Term]) -> None:
        """Mesh, spaces and forms."""
        self.grid = Grid(self.problem)
        self.scalar = ScalarSpace(self.grid)
        self.extraction_chi = spline_extraction(self.scalar)
        self._transposed_chi = self.extraction_chi.T.tocsr()
        kinds = {odd_in: images(self.scalar, odd_in) for odd_in in dict.fromkeys(self._odd_in())}
        #: The copies that each control point analyses.
        self.images: list[Images] = [kinds[odd_in] for odd_in in self._odd_in()]
        self.control_point = ControlPointForm(self.scalar, terms)
        self.design = DesignForm(self.scalar, terms)
        self.coefficients = self.extraction_chi.shape[1]
        self._free = np.array([copies.free for copies in self.images])
        ends = self.coefficients + np.cumsum(2 * self._free + 1)
        self._slices = [slice(a, b) for a, b in pairwise([self.coefficients, *ends])]

    def _odd_in(self) -> list[str]:
        """The axes in which each control point has an imperfection."""
        return [point.odd_in if point.eta_odd else "" for point in self.points]

    @property
    def free(self) -> int:
        """Columns of `State.u`: the free displacements of the control point that has most."""
        return int(self._free.max())

    # -- vectors ---------------------------------------------------------------------------------

    def control_point_vectors(self, state: State, j: int) -> list[FloatArray]:
        """Dofs of the compound space (chi, u_j, lam_j) of every copy that is analysed."""
        free = self._free[j]
        u = np.append(state.u[j, :free], self.points[j].d)
        lam = np.append(state.lam[j, :free], state.lam[j, -1])
        chi = self.extraction_chi @ state.chi
        fields = zip(self.images[j].fields(u), self.images[j].fields(lam), strict=True)
        return [np.concatenate([chi, *pair]) for pair in fields]

    def control_point_vector(self, state: State, j: int) -> FloatArray:
        """Those of the first copy: all there is without an imperfection."""
        return self.control_point_vectors(state, j)[0]

    def padded(self, u: Sequence[FloatArray], lam: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
        """Arrays of `State` from free displacements and multipliers of every control point."""
        all_u, all_lam = np.zeros((len(u), self.free)), np.zeros((len(u), self.free + 1))
        for j, free in enumerate(self._free):
            all_u[j, :free] = u[j]
            all_lam[j, :free], all_lam[j, -1] = lam[j][:-1], lam[j][-1]
        return all_u, all_lam

    def retarget(self, points: Sequence[ControlPoint]) -> None:
        """Go over to other control points, as many as before; all else stays.

        Raises
        ------
        ValueError
            If there are more or fewer, or an imperfection is of another kind.
        """
        if len(points) != len(self.points):
            raise ValueError(f"{len(points)} control points instead of {len(self.points)}")
        before = self._odd_in()
        self.problem = self.problem.replace(control_points=tuple(points))
        self.points = self.problem.control_points
        if self._odd_in() != before:
            raise ValueError(f"imperfections in {self._odd_in()} instead of {before}")
        self._weights = np.array([point.weight for point in self.points])
        self._targets = np.array([point.q_star for point in self.points])

    @timed("residual")
    def residual(self, state: State, chi_old: FloatArray, dt: float) -> Residual:
        """Eqs. 8, 7 and 4 at a state; ``dt = inf`` leaves the transient term out."""
        n = self.scalar.ndof
        terms: dict[str, FloatArray] = {}
        with np.errstate(all="ignore"):
            full = self.extraction_chi @ state.chi
            for name in self.design.terms:
                terms[name] = self._transposed_chi @ self.design.gradient(full, name)
            if np.isfinite(dt):
                change = self.extraction_chi @ (state.chi - chi_old)
                terms["transient"] = (
                    self._transposed_chi @ (self.design.transient_matrix @ change)
                ) / dt
            of_u, of_lam = [], []
            for j, copies in enumerate(self.images):
                results = self._results(state, j)
                of_chi = sum(c.share * r[:n] for c, r in zip(copies.copies, results, strict=True))
                terms[f"control point {j}"] = self._transposed_chi @ of_chi
                of_u.append(copies.reduced([r[n : 3 * n] for r in results])[:-1])
                of_lam.append(copies.reduced([r[3 * n :] for r in results]))
            u, lam = self.padded(of_u, of_lam)
            lam[:, -1] -= self._targets + state.lam[:, -1] / self._weights
        chi = sum(terms.values(), np.zeros(self.coefficients))
        norms = {name: float(np.linalg.norm(term)) for name, term in terms.items()}
        return Residual(chi, u, lam, norms)

    def _results(self, state: State, j: int) -> list[FloatArray]:
        """First derivatives of every copy of a control point, on the dofs of the compound space."""
        offsets = self.images[j].offsets(self.points[j].offset)
        vectors = self.control_point_vectors(state, j)
        return list(map(self.control_point.residual, vectors, offsets))

    @timed("terms")
    def terms(self, state: State) -> dict[str, float]:
        """Objective C with its terms (no transient one), each C_q, each q, and the volume V."""
        values = self.design.values(self.extraction_chi @ state.chi)
        forces = state.forces(self.problem)
        each = self._weights / 2 * (forces - self._targets) ** 2
        for j, value in enumerate(each):
            values[f"C_q{j + 1}"] = float(value)
        for j, force in enumerate(forces):
            values[f"q{j + 1}"] = float(force)
        of_design = sum(values[name] for name in self.design.terms)
        of_u: dict[str, float] = {}
        for j, point in enumerate(self.points if self.control_point.terms else ()):
            vectors = self.control_point_vectors(state, j)
            copies = self.images[j]
            offsets = copies.offsets(point.offset)
            for copy, vector, offset in zip(copies.copies, vectors, offsets, strict=True):
                for name, value in self.control_point.values(vector, offset).items():
                    of_u[name] = of_u.get(name, 0.0) + copy.share * value
        values["C"] = float(each.sum()) + of_design + sum(of_u.values())
        return {**values, **of_u}

    def adjoint_load(self, chi: FloatArray, u: FloatArray, j: int) -> FloatArray | None:
        """Derivative of the terms that depend on displacements by u, for Eq. 7 of a control point.

        Parameters
        ----------
        chi : array
            Dofs of the scalar space.
        u : array (free,)
            Free displacements of the control point.
        j : int
            Control point.

        Returns
        -------
        array (free + 1,) or None
            On the free displacements and u_Ty; None if there are no such terms.
        """
        if not self.control_point.terms:
            return None
        copies, point = self.images[j], self.points[j]
        fields = copies.fields(np.append(u, point.d))
        each = zip(fields, copies.offsets(point.offset), strict=True)
        return copies.reduced(self.control_point.adjoint_load(chi, *pair) for pair in each)

    # -- matrix ----------------------------------------------------------------------------------

    def assemble(self, state: State, dt: float) -> None:
        """Assemble the Newton matrix at a state and factorise it.

        Raises
        ------
        LinearSolveError
            If an entry is not finite, or the factorisation breaks down.
        """
        maps = self._prepared(state)
        unit = self._lam_unit
        # s of the size of lam: with a larger one the two halves cancel in the Schur complement of
        # chi and digits are lost (s = 1 costs seven of them near the optimum).
        s = float(np.clip(np.abs(state.lam).max() / unit, 1e-8, 1.0)) * unit / self._length_unit
        self._scale = s
        with self.timings.part("assembly"):
            chi_chi = maps.design(self.design, self.extraction_chi @ state.chi, dt)
        # chi in units that give its rows the size of the mechanical ones (they differ by 1e8).
        diagonal = np.abs(chi_chi[maps.chi_diagonal]).mean()
        known = 0 < diagonal < np.inf
        t = float(1 / np.sqrt(diagonal)) / self._length_unit if known else 1.0
        self._chi_unit = t
        scales = t, s, self._top_unit
        for j, point in enumerate(self.points):
            vectors = self.control_point_vectors(state, j)
            for k, offset in enumerate(self.images[j].offsets(point.offset)):
                with self.timings.part("assembly"):
                    tangent = self.control_point.tangent(vectors[k], offset)
                with self.timings.part("reduction"):
                    chi_chi += maps.write_control_point((j, k), *tangent, point.weight, scales)
        with self.timings.part("reduction"):
            maps.write("chi_chi", t**2 * chi_chi)
            finite = np.isfinite(maps.triangle.data).all()
        if not finite:
            raise LinearSolveError("the Newton matrix has entries that are not finite")
        self._factorize()

    @timed("factorisation")
    def _factorize(self) -> None:
        assert self._factorization is not None
        try:
            self._factorization.factorize()
        except Exception as error:
            raise LinearSolveError(f"the factorisation failed: {error}") from error

    @timed("preparation")
    def _prepared(self, state: State) -> BlockMaps:
        """The patterns and index maps, and a factorisation for them; made when first needed."""
        maps = self._maps
        if maps is None:
            with giving_memory_back():
                maps = self._maps = self._build_maps(state)
        if self._factorization is None:
            self._factorization = make_factorization(maps.triangle, self.solver, self.threads)
            maps.triangle = self._factorization.matrix
        return maps

    def _build_maps(self, state: State) -> BlockMaps:
        vector = self.control_point_vector(state, 0)
        self.control_point.tangent(vector, Offset())
        self.design.tangent_nonlinear(vector[: self.scalar.ndof])
        return BlockMaps(
            self.control_point,
            self.design,
            self.extraction_chi,
            self.images,
            wants_upper(self.solver),
        )

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the coupled system."""
        return int(self.coefficients + (2 * self._free + 1).sum())

    @property
    def nonzeros(self) -> int:
        """Stored entries of one triangle."""
        return 0 if self._maps is None else int(self._maps.triangle.nnz)

    @property
    def negative_eigenvalues(self) -> int | None:
        """Of the last factorised matrix; a saddle of the right kind has free + 1 per point."""
        return None if self._factorization is None else self._factorization.negative_eigenvalues

    @property
    def eigenvalues_of_a_minimum(self) -> int:
        """Negative eigenvalues of the Newton matrix where C(chi) is convex."""
        return int((self._free + 1).sum())

    # -- solution --------------------------------------------------------------------------------

    def _multiply(self, x: FloatArray) -> FloatArray:
        assert self._maps is not None
        return multiply(self._maps.triangle, x)

    def _pack(self, residual: Residual) -> FloatArray:
        return self._packed(self._chi_unit, residual, (1.0, self._scale, self._top_unit))

    def _packed(
        self, t: float, vector: State | Residual, factors: tuple[float, float, float]
    ) -> FloatArray:
        """chi times t; for each control point ``f u + g lam``, ``f u - g lam`` and ``h lam_Ty``."""
        f, g, h = factors
        parts = [t * vector.chi]
        for free, u, lam in zip(self._free, vector.u, vector.lam, strict=True):
            a, b = f * u[:free], g * lam[:free]
            parts += [a + b, a - b, h * lam[-1:]]
        return np.concatenate(parts)

    def _blocks(self, x: FloatArray, factors: tuple[float, float]) -> tuple[FloatArray, ...]:
        """u and lam: the sum of each point's halves, and factors times difference and last row."""
        f, g = factors
        u = np.zeros((len(self.points), self.free))
        lam = np.zeros((len(self.points), self.free + 1))
        for j, (n, part) in enumerate(zip(self._free, self._slices, strict=True)):
            a, b = x[part][:n], x[part][n : 2 * n]
            u[j, :n], lam[j, :n], lam[j, -1] = a + b, f * (a - b), g * x[part][-1]
        return u, lam

    def _unpack(self, x: FloatArray) -> State:
        u, lam = self._blocks(x, (self._scale, self._top_unit))
        return State(self._chi_unit * x[: self.coefficients], u, lam)

    def _unpack_residual(self, x: FloatArray) -> Residual:
        u, lam = self._blocks(x, (1 / (2 * self._scale), 1 / self._top_unit))
        return Residual(x[: self.coefficients] / self._chi_unit, u / 2, lam, {})

    def _block_norms(self, packed: FloatArray) -> FloatArray:
        """Of chi (as it is packed), and of the adjoint and the equilibrium of every point."""
        residual = self._unpack_residual(packed)
        adjoint, equilibrium = (np.linalg.norm(a, axis=1) for a in (residual.u, residual.lam))
        chi = np.linalg.norm(packed[: self.coefficients])
        return np.concatenate([[chi], adjoint, equilibrium])

    def product(self, update: State) -> Residual:
        """Product of the last assembled Newton matrix with an update, in the plain unknowns.

        What `solve` inverts: ``product(solve(residual)) = -residual``.
        """
        factors = 0.5, 0.5 / self._scale, 1 / self._top_unit
        packed = self._packed(1 / self._chi_unit, update, factors)
        return self._unpack_residual(self._multiply(packed))

    @timed("solve")
    def solve(self, residual: Residual) -> State:
        """Newton update ``-matrix^-1 residual``, refined until every block is solved.

        The chi rows are about 1e-8 of the mechanical ones, so the linear residual is judged block
        by block (chi, and for each control point adjoint and equilibrium): against the block of
        the right-hand side, or where that is itself mere rounding, against the block of
        ``|diagonal| |solution|``.

        Raises
        ------
        LinearSolveError
            If a block cannot be solved to 1e-6 of one or 1e-3 of the other.
        """
        assert self._factorization is not None
        assert self._maps is not None
        rhs = -self._pack(residual)
        given = self._block_norms(rhs)
        x = self._factorization.solve(rhs)
        size = self._block_norms(self._maps.diagonal() * x)
        fine = np.maximum(1e-9 * given, 1e-14 * size)
        coarse = np.maximum(1e-3 * given, 1e-6 * size)
        remaining = rhs - self._multiply(x)
        error = self._block_norms(remaining)
        for _ in range(4):
            if not np.isfinite(error).all() or (error <= fine).all():
                break
            trial = x + self._factorization.solve(remaining)
            trial_remaining = rhs - self._multiply(trial)
            trial_error = self._block_norms(trial_remaining)
            if not (trial_error / fine).max() < 0.5 * (error / fine).max():
                break
            x, remaining, error = trial, trial_remaining, trial_error
        if not np.isfinite(error).all():
            raise LinearSolveError("the linear solution is not finite")
        self.linear_error = float((error / np.maximum(size, 1e-300)).max())
        if (error > coarse).any():
            raise LinearSolveError(f"linear residual {self.linear_error:.1e} of its terms")
        return self._unpack(x)
