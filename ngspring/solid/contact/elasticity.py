"""Elasticity of a solid alone, without a void around it: energy, forces, tangent, stretches (3.5).

A `Solid` is a mesh of second-order triangles, an energy density and linear constraints; the spring
of a `Body` with the boundary conditions of 2.5 is one use of it, see
`ngspring.solid.contact.supports`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.constraints import DisplacementExtraction
from ngspring.fem.grid import Grid
from ngspring.fem.process import tasks
from ngspring.fem.reduction import (
    Pattern,
    csr_pattern,
    product_map,
    product_pattern,
    stored_values,
)
from ngspring.physics.chi import CF
from ngspring.physics.elasticity import measure, strain_energy, virtual_work
from ngspring.solid.contact.pressure import Excess, NodalPressure
from ngspring.solid.mesh.body import Body

#: Energy per area of the mesh (thickness or 2 pi r and the number of copies included) from u and
#: its gradient.
Density = Callable[[CF, CF], CF]

#: Points where the energy is integrated, the same everywhere so that forces are its derivative.
_RULE_ORDER = 4
#: Share of the volume that may be stretched more than `Solid.stretch_measure`.
STRETCHED_SHARE = 1e-3
_SAMPLES = ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0))


def numbered(
    parent: IntArray, weight: FloatArray, driven: int
) -> tuple[DisplacementExtraction, IntArray]:
    """The constraints ``u[i] = weight[i] * u[parent[i]]`` as an extraction of free unknowns.

    Parameters
    ----------
    parent : int array (2 ndof,)
        A dof of the VectorH1 space (x components first), each its own parent where it is free.
    weight : array (2 ndof,)
        0 where the displacement is zero.
    driven : int
        The dof whose value is prescribed.

    Returns
    -------
    extraction : DisplacementExtraction
        Its last column belongs to the driven dof.
    unknown : int array (2 ndof,)
        Number of the free unknown that a dof follows, -1 if none.
    """
    used = weight != 0.0
    is_master = np.zeros(len(parent), bool)
    is_master[parent[used]] = True
    is_master[driven] = False
    number = np.full(len(parent), -1)
    number[is_master] = np.arange(is_master.sum())
    free = int(is_master.sum())
    number[driven] = free
    master = np.where(used, number[parent], 0).astype(np.int64)
    unknown = np.where(used & (number[parent] < free), number[parent], -1)
    return DisplacementExtraction(master, weight, free), unknown.astype(np.int64)


class Solid:
    """Strain energy of a solid as a function of its displacement dofs, with linear constraints.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Triangles, curved to second order.
    density : callable
        Strain energy per area of the mesh, from u and grad u.
    matrix : sparse (2 ndof, free + 1)
        Linear constraints: dofs of VectorH1(order=2) on the mesh (x components first) <- free
        unknowns and, as the last column, the prescribed displacement d.
    floating : int array
        Free unknowns, one for each part of the solid that no constraint keeps from moving as a
        whole. In the linear systems, and only there, each is held by a soft spring: the forces of
        such a part are in balance, so the spring's force is zero and equilibrium is not touched.
    stretch_33 : callable, optional
        Stretch out of the plane from u; 1 by default.
    thickness : ngsolve.CoefficientFunction, optional
        Volume per area of the mesh in mm; 1 by default.
    excess : Excess, optional
        A bulk modulus on top of that of the density, see `ngspring.solid.contact.pressure`.

    Attributes
    ----------
    pressure : NodalPressure or None
        What carries it.
    """

    def __init__(
        self,
        mesh: Any,
        density: Density,
        matrix: sp.csr_matrix,
        floating: IntArray | None = None,
        stretch_33: Callable[[CF], CF] | None = None,
        thickness: CF | None = None,
        excess: Excess | None = None,
    ) -> None:
        self.mesh = mesh
        self.space = ng.VectorH1(mesh, order=2)
        self.matrix = matrix
        self.transposed = self.matrix.T.tocsr()
        self.free = matrix.shape[1] - 1
        self.floating = np.zeros(0, np.int64) if floating is None else floating
        u = self.space.TrialFunction()
        self._form = ng.BilinearForm(self.space, symmetric=True)
        self._form += ng.Variation(density(u, ng.Grad(u)).Compile() * ng.dx(intrules=_rules()))
        self.u = ng.GridFunction(self.space)
        self.u.vec[:] = 0.0
        self._result = self.u.vec.CreateVector()
        one = ng.CF(1.0)
        self._thickness = one if thickness is None else thickness
        self._stretch_33 = one if stretch_33 is None else stretch_33(self.u)
        with tasks():
            self._form.AssembleLinearization(self.u.vec)
        rows, columns = csr_pattern(self._form)
        #: Places of `tangent_values`, both triangles.
        self.pattern = product_pattern(rows, columns, self.matrix, self.matrix)
        self.pressure: NodalPressure | None = None
        if excess is not None:
            self.pressure = NodalPressure(mesh, excess, matrix, _rules())
            keys = np.union1d(self.pattern.keys, self.pressure.pattern.keys)
            self.pattern = Pattern(keys, self.pattern.shape)
        self._map = product_map(rows, columns, self.matrix, self.matrix, self.pattern)
        reduced = self.tangent(np.zeros(self.space.ndof))
        self.diagonal_at_rest: FloatArray = np.array(reduced.diagonal()[: self.free])

    @property
    def ndof(self) -> int:
        """Dofs of one component."""
        return int(self.space.ndof) // 2

    def set(self, full: FloatArray) -> None:
        """Load dofs into the grid function `u`, and into `pressure`."""
        self.u.vec.FV().NumPy()[:] = full
        if self.pressure is not None:
            self.pressure.set(full)

    def energy(self, full: FloatArray) -> float:
        """Strain energy in N mm; not finite if an element is inverted at an integration point."""
        self.u.vec.FV().NumPy()[:] = full
        with tasks():
            energy = float(self._form.Energy(self.u.vec))
        return energy if self.pressure is None else energy + self.pressure.energy(full)

    def forces(self, full: FloatArray) -> FloatArray:
        """Derivative of the energy by the dofs, in N."""
        self.u.vec.FV().NumPy()[:] = full
        with tasks():
            self._form.Apply(self.u.vec, self._result)
        forces = np.array(self._result.FV().NumPy())
        return forces if self.pressure is None else forces + self.pressure.forces(full)

    def tangent(self, full: FloatArray) -> sp.csr_matrix:
        """Second derivative by the free unknowns and d (last row and column), both triangles."""
        return self.pattern.matrix(self.tangent_values(full))

    def tangent_values(self, full: FloatArray) -> FloatArray:
        """The entries of `tangent` in the places of `pattern`."""
        self.u.vec.FV().NumPy()[:] = full
        with tasks():
            self._form.AssembleLinearization(self.u.vec)
        values = np.asarray(self._map @ stored_values(self._form))
        if self.pressure is not None:
            part = self.pressure.tangent(full).tocoo()
            keys = part.row.astype(np.int64) * part.shape[1] + part.col
            values[np.searchsorted(self.pattern.keys, keys)] += part.data
        return values

    def inverted(self, full: FloatArray) -> bool:
        """Whether det F <= 0 at an integration point or a vertex."""
        self.set(full)
        return bool((self._at_samples(ng.Det(ng.Id(2) + ng.Grad(self.u))) <= 0.0).any())

    def _at_samples(self, field: CF) -> NDArray[np.float64]:
        rule = ng.IntegrationRule(list(_SAMPLES), [1.0] * len(_SAMPLES))
        return np.asarray(field(self.mesh.MapToAllElements(rule, ng.VOL)))

    def largest_stretch(self, full: FloatArray) -> tuple[float, tuple[float, float]]:
        """Largest principal stretch and its place in the undeformed solid, in mm."""
        self.set(full)
        stretch = _largest_stretch(self._at_samples(self._strain))
        places = self._at_samples(ng.CF((ng.x, ng.y)))
        k = int(np.argmax(stretch))
        return float(stretch[k]), (float(places[k, 0]), float(places[k, 1]))

    def stretch_measure(self, full: FloatArray) -> float:
        """The principal stretch that a thousandth of the solid's volume exceeds.

        The largest one is that of a single point: where a surface folds onto itself it grows
        with every refinement. This one converges.
        """
        self.set(full)
        rule = ng.IntegrationRule(ng.TRIG, _RULE_ORDER)
        places = self.mesh.MapToAllElements(rule, ng.VOL)
        stretch = _largest_stretch(np.asarray(self._strain(places)))
        size = ng.Det(ng.specialcf.JacobianMatrix(2, 2)) * self._thickness
        volume = np.asarray(size(places)).ravel() * np.tile(rule.weights, self.mesh.ne)
        order = np.argsort(-stretch)
        beyond = np.cumsum(volume[order]) - volume[order] / 2
        return float(np.interp(STRETCHED_SHARE * volume.sum(), beyond, stretch[order]))

    @property
    def _strain(self) -> CF:
        """F : F and det F in the plane, and the stretch out of it."""
        f = ng.Id(2) + ng.Grad(self.u)
        return ng.CF((ng.InnerProduct(f, f), ng.Det(f), self._stretch_33))


def _largest_stretch(strain: FloatArray) -> FloatArray:
    trace, det = strain[:, 0], strain[:, 1]
    in_plane = np.sqrt(trace / 2 + np.sqrt(np.maximum(trace**2 / 4 - det**2, 0.0)))
    # On the axis u_r / r is 0 / 0; its limit is one of the stretches in the plane.
    return np.asarray(np.fmax(in_plane, strain[:, 2]))


def spring_density(body: Body) -> Density:
    """Energy density of a spring's solid: Eq. 14 with E(chi) = 1, for the whole spring.

    Without the excess of a nearly incompressible one (`ngspring.solid.contact.pressure`).
    """
    problem = body.problem
    return lambda u, grad_u: measure(problem) * strain_energy(u, grad_u, problem)


def _virtual_work(body: Body, solid: Solid, grad_u: CF, v: CF, grad_v: CF) -> CF:
    """P : delta F per area of the mesh, for the whole spring."""
    problem = body.problem
    work = measure(problem) * virtual_work(solid.u, grad_u, v, grad_v, problem)
    if solid.pressure is not None:
        work = work + solid.pressure.virtual_work(solid.u, grad_u, v, grad_v)
    return work


def section_force(body: Body, solid: Solid, full: FloatArray) -> float:
    """Vertical force in N carried by the solid's stresses, averaged over all heights.

    The virtual work of the nominal stress P (Eqs. 16, 17, 22) in a uniform vertical stretch of
    1 mm of the spring: the mean over all horizontal sections of the integral of ``P_yy``. Contact
    forces that cross a section are to be added.

    Its test function belongs to the space, so that in equilibrium it is the force on the sides but
    for rounding, on any mesh. It checks that the iteration has converged, that Eqs. 16 and 17 are
    the energy's derivative, and that contact is balanced; not the mesh, see `side_force`.
    """
    solid.set(full)
    # One over H for the quarter, too: it is stretched by half a millimetre over half the height.
    height = body.problem.H
    v, grad_v = ng.CF((0, ng.y / height)), ng.CF((0, 0, 0, 1 / height), dims=(2, 2))
    work = _virtual_work(body, solid, ng.Grad(solid.u), v, grad_v)
    with tasks():
        total = work.Compile() * ng.dx(intrules=_rules())
        return float(ng.Integrate(total, solid.mesh))


def side_force(body: Body, solid: Solid, full: FloatArray, side: str) -> float:
    """Vertical force in N of the solid's stresses on a loaded side: the integral of ``P_yy`` there.

    Stresses at a boundary are only as accurate as the mesh (for smooth solutions the error goes
    with the square of its size), so their distance from the force on the side is a measure of the
    mesh. For the whole spring; contact forces on a mirror plane are to be added.
    """
    solid.set(full)
    grid = Grid(body.problem)
    at_side = ng.BoundaryFromVolumeCF(ng.Grad(solid.u))
    zero, vertical = ng.CF((0, 0)), ng.CF((0, 0, 0, 1), dims=(2, 2))
    stress = _virtual_work(body, solid, at_side, zero, vertical)
    share = grid.sector.share
    with tasks():
        total = stress.Compile() * ng.ds(side, bonus_intorder=4)
        return share * float(ng.Integrate(total, solid.mesh))


def _rules() -> dict[Any, Any]:
    return {ng.ET.TRIG: ng.IntegrationRule(ng.ET.TRIG, _RULE_ORDER)}
