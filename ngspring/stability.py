"""Does a spring stay symmetric? Lowest eigenvalues of the full-domain tangent along a load path.

A design is doubly symmetric, and its load path is followed on one quarter, where nothing but
symmetric deformation is possible. Here the same states are mirrored to the full domain, where only
the boundary conditions of 2.5 restrict the displacements, and the tangent K at a prescribed d is
examined: while it is positive definite, the state is a minimum of the energy under displacement
control; where its lowest eigenvalue becomes negative, the spring leaves the symmetric path (a mode
that is antisymmetric in x or in y) or snaps (a symmetric one).

**Which eigenvalues.** ``K v = lambda M v``, M the linear-elastic stiffness of the undeformed
design, scaled with E(chi) as in Eq. 14, but faded to a thousandth of that in void and in grey of
E(chi) < 0.015 (chi < -2), and without the void regularisation. lambda is then a pure number that
does not depend on the mesh: the share of its stiffness that the spring's weakest deformation has
left. It is 1 at rest, falls like ``1 - load / buckling load`` where prestress acts linearly, and is
0 at a critical point. How many eigenvalues are negative does not depend on M (Sylvester); their
sizes and their order do:

- with a plain L2 mass the void's own modes, a million times softer than the solid's, come first;
- with a mass weighted with E(chi) mechanisms come first: a column that may move sideways in the
  void, an island of grey. Nothing but void holds them: nearly zero and harmless;
- with the stiffness not faded come grey cells, which soften when stretched several times over.

With M as above a mode that strains void or grey has a large eigenvalue as long as it is positive,
and the spring's own modes are the lowest ones. A negative eigenvalue of the third medium stays
negative and is told from the spring's by where its mode strains the material, `Mode.shares`. An
axisymmetric spring is examined for axisymmetric modes only.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu

from ngspring import energies
from ngspring.design import Design
from ngspring.errors import ConvergenceError, ProblemError
from ngspring.mechanics import Equilibrium, Mechanics
from ngspring.path import follow
from ngspring.problem import SpringProblem
from ngspring.response import _checked, nodal_values
from ngspring.spaces import Grid, ScalarSpace, spline_extraction
from ngspring.splines import FloatArray
from ngspring.states import curve_displacements
from ngspring.threads import parallel
from ngspring.void import integration_rule

logger = logging.getLogger(__name__)

#: Eigenvalues smaller than this in size are zero within rounding: a mechanism, no instability.
ZERO = 1e-8
#: At most so many negative eigenvalues are computed (all of them are counted).
MOST_NEGATIVE = 24
#: Stiffness E(chi) below which M fades, and what is left of it in the void.
GREY, FAINT = 0.015, 1e-3
_KINDS = ("solid", "grey", "void")


@dataclass(frozen=True, eq=False)
class Mode:
    """An eigenvector of the tangent.

    Attributes
    ----------
    eigenvalue : float
        lambda, see the description of the module.
    shares : tuple of 3 float
        Parts of the mode's linear-elastic strain energy (scaled with E(chi)) in solid (chi >= 0),
        grey (-5 < chi < 0) and void.
    parity : tuple of 2 float
        1 if the mode is symmetric about x = L/2 (y = H/2), -1 if antisymmetric, in between if it
        is a mixture. A mode that is symmetric about both is one of the quarter.
    nodes : array (2, nx, ny)
        The mode at vertices, edge middles and centres of the full domain's mesh (the half left of
        the axis if axisymmetric); its largest entry is 1.
    """

    eigenvalue: float
    shares: tuple[float, float, float]
    parity: tuple[float, float]
    nodes: FloatArray

    @property
    def kind(self) -> str:
        """Where most of its strain energy is: "solid", "grey" or "void"."""
        return _KINDS[int(np.argmax(self.shares))]

    @property
    def symmetry(self) -> tuple[str, str]:
        """In x and in y: "symmetric", "antisymmetric" or "mixed"."""
        x, y = (
            "mixed" if abs(p) < 0.9 else "symmetric" if p > 0 else "antisymmetric"
            for p in self.parity
        )
        return x, y

    @property
    def symmetry_text(self) -> str:
        """Symmetry in words."""
        x, y = self.symmetry
        return f"{x} in x and y" if x == y else f"{x} in x, {y} in y"


@dataclass(frozen=True, eq=False)
class StabilityPoint:
    """The tangent at one displacement.

    Attributes
    ----------
    d, q : float
        Displacement in mm and reaction force in N.
    modes : tuple of Mode
        The lowest ones in increasing order: all with a negative eigenvalue (the 24 nearest zero if
        there are more) and a few more.
    negative : int or None
        Number of negative eigenvalues by the inertia of a factorisation (PARDISO's, or scipy's if
        that is not installed), a count that owes nothing to the eigenvalue solver; None if that
        failed, and the modes are then those next to zero.
    imbalance : float
        Norm of the forces on the full domain's free displacements, relative to the reaction force
        plus the one at 0.1 % strain: rounding errors, if the mirrored state is in equilibrium.
    u : array (2, nx, ny)
        The mirrored state in mm at the places of `Mode.nodes`.
    """

    d: float
    q: float
    modes: tuple[Mode, ...]
    negative: int | None
    imbalance: float
    u: FloatArray

    @property
    def lowest(self) -> float:
        """The lowest eigenvalue."""
        return self.modes[0].eigenvalue

    @property
    def verdict(self) -> str:
        """One of "stable", "neutral" (zero within rounding) and "unstable"."""
        if self.unstable_mode() is not None:
            return "unstable"
        return "neutral" if self.lowest <= ZERO else "stable"

    def unstable_mode(self, kind: str | None = None) -> Mode | None:
        """The mode with the lowest eigenvalue (of this kind) if that is negative."""
        modes = (mode for mode in self.modes if kind in (None, mode.kind))
        lowest = next(modes, None)
        return None if lowest is None or lowest.eigenvalue >= -ZERO else lowest

    def like(self, mode: Mode) -> Mode | None:
        """The lowest mode here with the kind and symmetry of another."""
        wanted = mode.kind, mode.symmetry
        return next((m for m in self.modes if (m.kind, m.symmetry) == wanted), None)


@dataclass(frozen=True, eq=False)
class Critical:
    """Where the path loses its stability on the way from rest.

    Attributes
    ----------
    point : StabilityPoint
        The state, computed at the displacement where the eigenvalue is zero by interpolation; the
        nearest unstable one if the mode is not among the lowest of the stable state before.
    mode : Mode
        The mode with this eigenvalue, as it is in `point`.
    bracket : tuple of 2 float
        The nearest displacements in mm computed before, stable and unstable; at most 0.01 H apart.
    """

    point: StabilityPoint
    mode: Mode
    bracket: tuple[float, float]

    @property
    def d(self) -> float:
        """Critical displacement in mm."""
        return self.point.d

    @property
    def q(self) -> float:
        """Critical force in N."""
        return self.point.q


@dataclass(frozen=True, eq=False)
class Stability:
    """Outcome of `stability`.

    Attributes
    ----------
    problem : SpringProblem
    eta : float
        Offset of chi.
    points : tuple of StabilityPoint
        One for each requested displacement that was reached, in increasing order of d.
    critical : tuple of Critical
        First loss of stability in compression and in tension, if any. If its mode is one of grey
        or void, it is followed by the first one in the solid, if any.
    rest : float
        The lowest eigenvalue at d = 0.
    complete : bool
        Whether every displacement was reached.
    message : str
        Where and why the path ended, if it did.
    """

    problem: SpringProblem
    eta: float
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
        """Whether no unstable state was found."""
        return not self.critical

    @property
    def spring_stable(self) -> bool:
        """Whether no unstable mode in the solid was found, whatever grey and void do."""
        return all(critical.mode.kind != "solid" for critical in self.critical)


def mirrored(part: ScalarSpace, whole: ScalarSpace, field: FloatArray, d: float) -> FloatArray:
    """A quarter's displacements on the full domain (dofs of the VectorH1 spaces).

    ``u_x(L - x, y) = -u_x(x, y)`` and ``u_y(x, H - y) = d - u_y(x, y)``, exact to the last digit
    because the basis is hierarchical: bubbles are mirrored like values, and d has none.

    Parameters
    ----------
    part, whole : ScalarSpace
        Of the domains "quarter" and "full".
    field : array (2 ndof of part,)
    d : float
        Displacement of the top side in mm.
    """
    nx, ny = (2 * cells for cells in part.grid.cells)
    i, j = whole.node[:, 0], whole.node[:, 1]
    right, upper = i > nx, j > ny
    place = np.empty((nx + 1, ny + 1), dtype=np.int64)
    place[part.node[:, 0], part.node[:, 1]] = np.arange(part.ndof)
    twin = place[np.where(right, 2 * nx - i, i), np.where(upper, 2 * ny - j, j)]
    u_x, u_y = field.reshape(2, -1)[:, twin]
    top = np.where(whole.is_vertex(np.arange(whole.ndof)), d, 0.0)
    return np.concatenate([np.where(right, -u_x, u_x), np.where(upper, top - u_y, u_y)])


def inertia(matrix: sp.csr_matrix) -> int | None:
    """Number of negative eigenvalues of a symmetric matrix, by scipy's LU factorisation.

    Rows and columns are ordered alike and pivots stay on the diagonal, so that the signs of U's
    diagonal are those of an L D L^T. None if a pivot had to be taken elsewhere.
    """
    factors = splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True, "Equil": False},
    )
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return None
    return int((factors.U.diagonal() < 0).sum())


class FullTangent(Mechanics):
    """The tangent on the full domain: its inertia and its lowest modes."""

    def __init__(
        self, scalar: ScalarSpace, chi: FloatArray, eta: float, solver: str, threads: int
    ) -> None:
        super().__init__(scalar, chi, eta, solver, threads)
        space, problem = self._u.space, scalar.grid.problem
        u = space.TrialFunction()
        stiff = energies.stiffness(self._field + self._eta, problem)
        kept = FAINT + (1 - FAINT) * stiff**2 / (stiff**2 + GREY**2)
        density = energies.measure(scalar.grid) * kept * stiff
        density = density * energies.strain_energy(u, ng.Grad(u), problem)
        rule = {ng.ET.QUAD: integration_rule()}
        form = ng.BilinearForm(space, symmetric=True)
        form += ng.Variation(density.Compile() * ng.dx(intrules=rule))
        self._u.vec[:] = 0.0
        form.AssembleLinearization(self._u.vec)
        values = self._map @ form.mat.AsVector().FV().NumPy()
        self._mass = self._symmetric(values[self._lower_entries])
        table = self.void.table
        self._places = scalar.grid.mesh(table.x.ravel(), table.y.ravel())
        decay = np.exp(-np.maximum(self._at_points, -200.0))
        stiffness = problem.E_0 + (1 - problem.E_0) / (1 + (1 + problem.p) * decay)
        self._weights = stiffness * table.weights
        self._region = (self._at_points < 0).astype(np.int64) + (self._at_points <= -5)
        self._twins = [scalar.opposite(np.arange(scalar.ndof), axis) for axis in (0, 1)]

    def _symmetric(self, lower_values: FloatArray) -> sp.csr_matrix:
        pattern = self._lower
        parts = (lower_values, pattern.indices, pattern.indptr)
        lower = sp.csr_matrix(parts, shape=pattern.shape)
        return sp.csr_matrix(lower + sp.tril(lower, -1).T)

    def lowest(
        self, d: float, u: FloatArray, count: int
    ) -> tuple[FloatArray, FloatArray, int | None]:
        """Lowest eigenvalues of the tangent at a state.

        Parameters
        ----------
        d : float
        u : array (free,)
        count : int
            How many; all negative ones come on top. At rest, where the whole solid has 1, there
            is only one.

        Returns
        -------
        values : array (k,)
            In increasing order, accurate to four digits.
        vectors : array (free, k)
            With ``v.M v = 1``.
        negative : int or None
            How many are negative by the inertia of the factorisation.

        Raises
        ------
        ConvergenceError
            If the tangent is not finite, or the eigenvalues do not converge.
        """
        self.assemble(d, u)
        assert self._factorization is not None
        negative = self._factorization.negative_eigenvalues
        tangent = self._symmetric(self._lower.data)
        if negative is None:
            negative = inertia(tangent)
        # Of 1 / lambda: the largest in size; or the largest, and all negative ones.
        at_rest = d == 0.0
        wanted = [("LM", 1 if at_rest else count)]
        if negative:
            wanted = [("LA", count), ("SA", min(negative, MOST_NEGATIVE))]
        inverse = LinearOperator(tangent.shape, matvec=self.solve_linear, dtype=float)
        found = []
        for which, k in wanted:
            try:
                pair = eigsh(
                    tangent,
                    k,
                    self._mass,
                    sigma=0.0,
                    which=which,
                    OPinv=inverse,
                    v0=np.random.default_rng(0).uniform(-1, 1, self.free),
                    ncv=max(40, 2 * k + 10),
                    tol=1e-2 if at_rest else 1e-4,
                )
            except ArpackNoConvergence as error:
                raise ConvergenceError(f"eigenvalues at d = {d:g} mm: {error}") from error
            found.append(pair)
        values = np.concatenate([pair[0] for pair in found])
        vectors = np.hstack([pair[1] for pair in found])
        order = np.argsort(values)
        return values[order], vectors[:, order], negative

    def mode(self, value: float, v: FloatArray) -> Mode:
        """Describe an eigenvector."""
        full = np.asarray(self.extraction @ np.append(v, 0.0))
        components = full.reshape(2, -1)
        image_x = (components * [[-1.0], [1.0]])[:, self._twins[0]].ravel()
        image_y = (components * [[1.0], [-1.0]])[:, self._twins[1]].ravel()
        product = self._mass @ v
        parity = [
            float(product @ self.displacement.restrict(image)[:-1] / (product @ v))
            for image in (image_x, image_y)
        ]
        if self.scalar.grid.half_width:
            parity[0] = 1.0
        nodes = np.array([nodal_values(self.scalar, part) for part in components])
        nodes /= nodes.flat[np.abs(nodes).argmax()]
        return Mode(value, self._shares(full), (parity[0], parity[1]), nodes)

    def _shares(self, full: FloatArray) -> tuple[float, float, float]:
        """Parts of the strain energy in solid, grey and void."""
        self._u.vec.FV().NumPy()[:] = full
        problem = self.scalar.grid.problem
        a, b, c, e = np.asarray(ng.Grad(self._u)(self._places)).T
        hoop = np.zeros_like(a)
        if problem.axisymmetric:
            u_r = -np.asarray(self._u.components[0](self._places)).ravel()
            hoop = u_r / (problem.L / 2 - self.void.table.x.ravel())
        trace = a + e + hoop
        squared = a**2 + e**2 + hoop**2 + (b + c) ** 2 / 2
        density = problem.K * trace**2 + 2 * problem.G * (squared - trace**2 / 3)
        energy = (self._weights.ravel() * density).astype(float)
        parts = np.bincount(self._region.ravel(), weights=energy, minlength=3)
        solid, grey, void = (float(part) for part in parts / parts.sum())
        return solid, grey, void


class _Analysis:
    """A load path on the quarter whose states are examined on the full domain."""

    def __init__(self, design: Design, eta: float, modes: int, solver: str, threads: int) -> None:
        def prepared(domain: str) -> tuple[ScalarSpace, FloatArray]:
            scalar = ScalarSpace(Grid(design.problem.replace(domain=domain)))
            return scalar, spline_extraction(scalar) @ design.coefficients.ravel()

        self.part, chi = prepared("quarter")
        self.quarter = Mechanics(self.part, chi, eta, solver, threads)
        self.whole, chi = prepared("full")
        self.tangent = FullTangent(self.whole, chi, eta, solver, threads)
        self.modes = modes
        self.rest = self.quarter.at_rest()
        self._small = 1e-3 * design.problem.H * self.rest.stiffness

    def examine(self, state: Equilibrium) -> StabilityPoint:
        """Mirror a state to the full domain and compute its lowest modes."""
        d, tangent = state.d, self.tangent
        field = mirrored(self.part, self.whole, self.quarter.full_field(d, state.u), d)
        u = tangent.displacement.restrict(field)[:-1]
        forces = tangent.forces(d, u)[:-1]
        imbalance = float(np.linalg.norm(forces)) / (abs(state.q) + self._small)
        values, vectors, negative = tangent.lowest(d, u, self.modes)
        modes = tuple(tangent.mode(float(w), v) for w, v in zip(values, vectors.T, strict=True))
        found = int((values < 0).sum())
        if negative is not None and found != min(negative, MOST_NEGATIVE):
            logger.warning(
                "d = %g mm: %d negative eigenvalues by inertia, %d found", d, negative, found
            )
        logger.info("d = %g mm: lowest eigenvalue %.4g, in %s", d, values[0], modes[0].kind)
        nodes = np.array([nodal_values(self.whole, part) for part in field.reshape(2, -1)])
        return StabilityPoint(d, state.q, modes, negative, imbalance, nodes)

    def first_loss(
        self, side: list[tuple[Equilibrium, StabilityPoint]], kind: str | None
    ) -> Critical | None:
        """First loss of stability (by a mode of this kind) along examined states from rest."""
        for (before, stable), (after, unstable) in pairwise(side):
            if unstable.unstable_mode(kind) is not None:
                return self._locate(before, stable, after, unstable, kind)
        return None

    def _locate(
        self,
        before: Equilibrium,
        stable: StabilityPoint,
        after: Equilibrium,
        unstable: StabilityPoint,
        kind: str | None,
    ) -> Critical:
        height = self.part.grid.problem.H
        while True:
            mode = unstable.unstable_mode(kind)
            assert mode is not None
            partner = stable.like(mode)
            # Only with the mode's eigenvalue on both sides can the zero be interpolated.
            widest = (0.001 if partner is None else 0.01) * height
            if abs(after.d - before.d) <= widest:
                break
            reached, _ = follow(self.quarter, np.array([(before.d + after.d) / 2]), before)
            if not reached:
                break
            point = self.examine(reached[0])
            if point.unstable_mode(kind) is None:
                before, stable = reached[0], point
            else:
                after, unstable = reached[0], point
        bracket = (before.d, after.d)
        if partner is None:
            return Critical(unstable, mode, bracket)
        share = partner.eigenvalue / (partner.eigenvalue - mode.eigenvalue)
        d = before.d + min(max(share, 0.0), 1.0) * (after.d - before.d)
        reached, _ = follow(self.quarter, np.array([d]), before)
        if not reached:
            return Critical(unstable, mode, bracket)
        point = self.examine(reached[0])
        return Critical(point, point.like(mode) or mode, bracket)


def stability(
    design: Design,
    displacements: Iterable[float] | None = None,
    *,
    eta: float = 0.0,
    modes: int = 4,
    threads: int | None = None,
    solver: str = "auto",
) -> Stability:
    """Examine whether the symmetric load path of a design is stable under displacement control.

    Parameters
    ----------
    design : Design
    displacements : iterable of float, optional
        Displacements in mm; by default nine evenly spaced ones between the outermost control
        points (and zero), the control points, and zero.
    eta : float
        Offset of chi: dilation or erosion (2.6).
    modes : int
        How many of the lowest modes to compute, on top of all negative ones.
    threads, solver
        See `ngspring.optimize`.

    Returns
    -------
    Stability

    Raises
    ------
    ProblemError
        For a displacement that is not a finite number smaller than H in size, an eta that is not
        finite, or less than one mode.
    ConvergenceError
        If eigenvalues do not converge.
    """
    problem = design.problem
    if displacements is None:
        controls = [point.d for point in problem.control_points]
        displacements = [0.0, *controls, *curve_displacements(design, points=9)]
    targets = _checked(displacements, problem)
    if not np.isfinite(eta):
        raise ProblemError(f"eta = {eta!r} must be a finite number")
    if modes < 1:
        raise ProblemError(f"modes = {modes!r} must be at least 1")
    with parallel(threads) as count:
        analysis = _Analysis(design, eta, modes, solver, count)
        rest = analysis.examine(analysis.rest)
        points = [rest] if 0.0 in targets else []
        critical: list[Critical] = []
        messages = []
        for targets_of_side in (targets[targets < 0][::-1], targets[targets > 0]):
            states, message = follow(analysis.quarter, targets_of_side, analysis.rest)
            if message:
                logger.warning(message)
                messages.append(message)
            examined = [analysis.examine(state) for state in states]
            points += examined
            side = [(analysis.rest, rest), *zip(states, examined, strict=True)]
            first = analysis.first_loss(side, None)
            if first is not None:
                critical.append(first)
                if first.mode.kind != "solid":
                    further = analysis.first_loss(side, "solid")
                    critical += [] if further is None else [further]
    points.sort(key=lambda point: point.d)
    return Stability(
        problem=problem,
        eta=eta,
        points=tuple(points),
        critical=tuple(critical),
        rest=rest.lowest,
        complete=not messages,
        message="; ".join(messages),
    )
