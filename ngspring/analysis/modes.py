"""Lowest modes of a spring's tangent on the full domain.

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
negative and is told from the spring's by where its mode strains the material, `Mode.shares`.
"""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ngspring.analysis.forward import nodal_values
from ngspring.analysis.mechanics import Mechanics
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.fem.grid import ScalarSpace
from ngspring.fem.linear import inertia
from ngspring.physics.chi import Field, stiffness
from ngspring.problem.material import split_bulk_modulus

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


def mirrored(part: ScalarSpace, whole: ScalarSpace, field: FloatArray, d: float) -> FloatArray:
    """A quarter's displacements on the full domain (dofs of the VectorH1 spaces).

    Exact to the last digit because the basis is hierarchical: bubbles are mirrored like values
    (`ngspring.problem.sector.Mirror`), and d has none.

    Parameters
    ----------
    part, whole : ScalarSpace
        Of the domains "quarter" and "full".
    field : array (2 ndof of part,)
    d : float
        Displacement of the top side in mm.
    """
    node = whole.node.copy()
    signs, shift = np.ones((2, whole.ndof)), np.zeros((2, whole.ndof))
    vertex = whole.is_vertex(np.arange(whole.ndof))
    for mirror in part.grid.sector.mirrors:
        middle = 2 * part.grid.cells[mirror.axis]
        beyond = node[:, mirror.axis] > middle
        node[beyond, mirror.axis] = 2 * middle - node[beyond, mirror.axis]
        signs[:, beyond] *= mirror.signs[:, None]
        shift[:, beyond & vertex] += mirror.translation(d)[:, None]
    place = np.empty([2 * cells + 1 for cells in part.grid.cells], dtype=np.int64)
    place[part.node[:, 0], part.node[:, 1]] = np.arange(part.ndof)
    twin = place[node[:, 0], node[:, 1]]
    return np.asarray(signs * field.reshape(2, -1)[:, twin] + shift).ravel()


class FullTangent:
    """The tangent on the full domain: its inertia and its lowest modes.

    Attributes
    ----------
    body : Mechanics
        Of the full domain.
    mass : scipy.sparse.csr_matrix (free, free)
        What eigenvalues are relative to: the stiffness of the solid at rest.
    """

    def __init__(
        self, scalar: ScalarSpace, chi: FloatArray, eta: float, solver: str, threads: int
    ) -> None:
        self.scalar = scalar
        self.body = body = Mechanics(scalar, chi, eta, solver, threads)
        problem = scalar.grid.problem

        def kept(chi: Field) -> Field:
            stiff = stiffness(chi, problem)
            return FAINT + (1 - FAINT) * stiff**2 / (stiff**2 + GREY**2)

        self.mass = body.faded_stiffness_at_rest(kept)
        table, at_points = body.void.table, body.chi_at_points
        self._u = ng.GridFunction(ng.VectorH1(scalar.grid.mesh, order=2))
        self._places = scalar.grid.mesh(table.x.ravel(), table.y.ravel())
        self._weights = stiffness(at_points, problem) * table.weights
        self._region = (at_points < 0).astype(np.int64) + (at_points <= -5)
        self._twins = [scalar.opposite(np.arange(scalar.ndof), axis) for axis in (0, 1)]

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
        self.body.assemble(d, u)
        negative, tangent = self.body.negative_eigenvalues, self.body.tangent
        if negative is None:
            negative = inertia(tangent)
        # Of 1 / lambda: the largest in size; or the largest, and all negative ones.
        at_rest = d == 0.0
        wanted = [("LM", 1 if at_rest else count)]
        if negative:
            wanted = [("LA", count), ("SA", min(negative, MOST_NEGATIVE))]
        inverse = LinearOperator(tangent.shape, matvec=self.body.solve_linear, dtype=float)
        found = []
        for which, k in wanted:
            try:
                pair = eigsh(
                    tangent,
                    k,
                    self.mass,
                    sigma=0.0,
                    which=which,
                    OPinv=inverse,
                    v0=np.random.default_rng(0).uniform(-1, 1, self.body.free),
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
        full = self.body.full_field(0.0, v)
        components = full.reshape(2, -1)
        product = self.mass @ v
        parity = []
        for axis, twin in enumerate(self._twins):
            image = np.where(np.arange(2)[:, None] == axis, -1.0, 1.0) * components[:, twin]
            moved = self.body.images.restrict(image.ravel())
            parity.append(float(product @ moved / (product @ v)))
        if self.scalar.grid.sector.half_width:
            parity[0] = 1.0
        nodes = np.array([nodal_values(self.scalar, part) for part in components])
        nodes /= nodes.flat[np.abs(nodes).argmax()]
        return Mode(value, self._shares(full), (parity[0], parity[1]), nodes)

    def _shares(self, full: FloatArray) -> tuple[float, float, float]:
        """Parts of the strain energy in solid, grey and void."""
        self._u.vec.FV().NumPy()[:] = full
        problem = self.scalar.grid.problem
        a, b, c, e = np.asarray(ng.Grad(self._u)(self._places)).T
        u_x = np.asarray(self._u.components[0](self._places)).ravel()
        hoop = problem.motion.F_33(u_x, self.body.void.table.x.ravel(), problem.L) - 1.0
        trace = a + e + hoop
        squared = a**2 + e**2 + hoop**2 + (b + c) ** 2 / 2
        bulk = split_bulk_modulus(problem.K, problem.G)[0]
        density = bulk * trace**2 + 2 * problem.G * (squared - trace**2 / 3)
        energy = (self._weights.ravel() * density).astype(float)
        parts = np.bincount(self._region.ravel(), weights=energy, minlength=3)
        solid, grey, void = (float(part) for part in parts / parts.sum())
        return solid, grey, void
