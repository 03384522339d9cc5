"""Frictionless contact of a surface with itself and with mirror planes, as an energy (3.5).

Every Gauss-Lobatto point of the surface's edges (their ends are points, so that a sharp corner
cannot slip in between) looks for the surface in front of it (`ngspring.solid.contact.pairs`) and
pays for a negative gap g with the energy phi(g) / 2 per undeformed area,

    phi' = -p,    p(g) = kappa (-g - epsilon / 2) for g < -epsilon,
                  p(g) = kappa g^2 / (2 epsilon)  in between,    p = 0 for g > 0.

The half stands because both surfaces do so ("two half passes": no master, no slave). p is then the
contact pressure. Forces are the exact derivative of the energy; since a closest distance changes
only along the normal, they are normal to the surface (frictionless), equal and opposite, and
balanced in moment. The area is the undeformed one: an area that changed with the displacement
would add tangential forces. In the axisymmetric case it carries 2 pi R with the undeformed radius R
for the same reason.

Why not a barrier: a barrier keeps surfaces apart by a distance that depends on its parameters, and
acts before they touch. This energy is exactly zero before, and what surfaces overlap is p / kappa,
a few micrometres. That surfaces cannot jump through each other is looked after separately, see
`ngspring.solid.contact.tunnelling`. A mirror plane is contact with the own image, at twice the
distance.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.special import eval_legendre, roots_jacobi

from ngspring.basics.arrays import FloatArray
from ngspring.solid.contact.pairs import Pairs, PairSearch
from ngspring.solid.contact.supports import Plane
from ngspring.solid.contact.surface import CURVATURES, Surface, outward, shapes, slopes


@dataclass(frozen=True)
class ContactLaw:
    """Pressure p as a function of the gap.

    Attributes
    ----------
    kappa : float
        Stiffness in MPa/mm.
    epsilon : float
        Width in mm of the smooth start, which gives the energy a continuous second derivative.
    """

    kappa: float
    epsilon: float

    def softened(self, factor: float) -> ContactLaw:
        """A softer and smoother law for the way to an equilibrium."""
        return ContactLaw(self.kappa / factor, self.epsilon * factor**0.5)

    def energy(self, gap: FloatArray) -> FloatArray:
        """phi(g) in N/mm."""
        t, e = np.maximum(-gap, 0.0), self.epsilon
        return self.kappa * np.where(t < e, t**3 / (6 * e), t * t / 2 - e * t / 2 + e * e / 6)

    def pressure(self, gap: FloatArray) -> FloatArray:
        """p = -phi' in MPa."""
        t, e = np.maximum(-gap, 0.0), self.epsilon
        return self.kappa * np.where(t < e, t * t / (2 * e), t - e / 2)

    def slope(self, gap: FloatArray) -> FloatArray:
        """phi'' in MPa/mm."""
        return self.kappa * np.clip(-gap / self.epsilon, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class ContactState:
    """Contact at one displacement field.

    Attributes
    ----------
    positions : array (nodes, 2)
        Deformed nodes of the surface.
    pairs : Pairs
        Points with the surface in front of them.
    plane_gaps : array (planes, points)
        Distance of every point from each plane in mm.
    smallest_gap : float
        In mm, negative where surfaces overlap; infinite if nothing is near. Points that lie on a
        plane from the beginning, where the surface ends, do not count.
    """

    positions: FloatArray
    pairs: Pairs
    plane_gaps: FloatArray
    smallest_gap: float


def lobatto(count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Lobatto points, ends included, and weights on [0, 1]."""
    # The inner points are those of the Jacobi polynomial with weight 1 - x^2.
    inner = roots_jacobi(count - 2, 1.0, 1.0)[0] if count > 2 else np.zeros(0)
    nodes = np.concatenate([[-1.0], inner, [1.0]])
    weights = 2 / (count * (count - 1) * eval_legendre(count - 1, nodes) ** 2)
    return (nodes + 1) / 2, weights / 2


class Contact:
    """Energy, forces and second derivative of contact.

    Parameters
    ----------
    surface : Surface
    planes : tuple of Plane
    law : ContactLaw
    measure : callable
        From undeformed places (points, 2) to thickness or 2 pi R, times the number of copies.
    count : int
        Points on each edge.
    """

    def __init__(
        self,
        surface: Surface,
        planes: tuple[Plane, ...],
        law: ContactLaw,
        measure: Callable[[FloatArray], FloatArray],
        count: int = 10,
    ) -> None:
        self.surface = surface
        self.planes = planes
        self.law = law
        self._measure = measure
        self.s, weights = lobatto(count)
        self.edge = np.repeat(np.arange(surface.edges), count)
        #: Place in the undeformed state (points, 2) and length per point in mm.
        self.rest = surface.at(surface.rest, self.s).reshape(-1, 2)
        speed = np.linalg.norm(surface.slopes_at(surface.rest, self.s), axis=-1)
        self.length = (speed * weights).ravel()
        #: Undeformed area of each point in mm^2, all copies.
        self.area = self.length * measure(self.rest)
        self._shape = np.tile(shapes(self.s), (surface.edges, 1))
        self._search = PairSearch(surface, self.s)
        n = surface.matrix.shape[1]
        self._matrix = sp.block_diag([surface.matrix, surface.matrix], format="csr")
        self._transposed = self._matrix.T.tocsr()
        rows = np.repeat(np.arange(len(self.edge)), 3)
        self._points = sp.csr_matrix(
            (self._shape.ravel(), (rows, surface.nodes[self.edge].ravel())),
            shape=(len(self.edge), len(surface.rest)),
        )
        # d gap / d dofs of every point for each plane; the gap is linear.
        self._plane_rows = [self._plane_matrix(plane, n) for plane in planes]
        self._plane_gaps_at_rest = np.array(
            [self.rest @ np.array(plane.normal) - plane.offset for plane in planes]
        ).reshape(-1, len(self.edge))
        self._apart = np.ones(self._plane_gaps_at_rest.shape, bool)

    def _plane_matrix(self, plane: Plane, n: int) -> sp.csr_matrix:
        axis = int(plane.normal[0] == 0.0)
        sign = plane.normal[axis]
        points = sp.csr_matrix(self._points @ self.surface.matrix) * sign
        empty = sp.csr_matrix(points.shape)
        rows = sp.hstack([points, empty] if axis == 0 else [empty, points], format="csr")
        if plane.dof is not None:
            count = rows.shape[0]
            column = np.full(count, plane.dof)
            moving = (np.full(count, sign), (np.arange(count), column))
            rows = rows - sp.csr_matrix(moving, shape=rows.shape)
        return sp.csr_matrix(rows)

    def leave_out_held(self, extraction: sp.csr_matrix) -> None:
        """Leave out of contact with a plane the points that constraints hold on it.

        They are where the surface ends on a side; rounding must not look like contact there.
        """
        for k, rows in enumerate(self._plane_rows):
            moves = sp.csr_matrix(abs(rows @ extraction)).max(axis=1).toarray().ravel() > 1e-12
            self._apart[k] = moves | (self._plane_gaps_at_rest[k] > 1e-6 * self.length.max())

    def with_law(self, law: ContactLaw) -> Contact:
        """The same contact with another law."""
        other = copy.copy(self)
        other.law = law
        return other

    def state(self, full: FloatArray, ahead: bool = True) -> ContactState:
        """Find what touches what at these dofs of the VectorH1 space.

        Without ``ahead`` no surface is looked for in front of points where nothing touches.
        """
        positions = self.surface.positions(full)
        pairs = self._search.find(positions, ahead)
        gaps = self._plane_gaps_at_rest + np.array(
            [rows @ full for rows in self._plane_rows]
        ).reshape(-1, len(self.edge))
        gaps = np.where(self._apart, gaps, 0.0)
        smallest = min(pairs.gap.min(initial=np.inf), 2 * gaps[self._apart].min(initial=np.inf))
        return ContactState(positions, pairs, gaps, float(smallest))

    def energy(self, state: ContactState) -> float:
        """Contact energy in N mm."""
        pairs = state.pairs
        between = self.area[pairs.point] @ self.law.energy(pairs.gap)
        return float(between + (self.law.energy(2 * state.plane_gaps) @ self.area).sum()) / 2

    def forces(self, state: ContactState) -> FloatArray:
        """Derivative of the energy by the dofs, in N."""
        pairs = state.pairs
        touching = np.flatnonzero(pairs.gap < 0.0)
        point, edge, s = pairs.point[touching], pairs.edge[touching], pairs.s[touching]
        force = -(self.area[point] * self.law.pressure(pairs.gap[touching]) / 2)[:, None]
        push = force * pairs.normal[touching]
        nodes = np.concatenate([self.surface.nodes[self.edge[point]], self.surface.nodes[edge]], 1)
        factor = np.concatenate([self._shape[point], -shapes(s)], axis=1)
        count = len(self.surface.rest)
        parts = [
            np.bincount(nodes.ravel(), (factor * push[:, axis, None]).ravel(), count)
            for axis in (0, 1)
        ]
        total = np.asarray(self._transposed @ np.concatenate(parts))
        for rows, gap in zip(self._plane_rows, state.plane_gaps, strict=True):
            total = total - rows.T @ (self.area * self.law.pressure(2 * gap))
        return total

    def linear_gaps(
        self, state: ContactState, extraction: sp.csr_matrix
    ) -> tuple[FloatArray, sp.csr_matrix, FloatArray]:
        """All gaps that are not closed, their derivatives by the unknowns, and the areas.

        What a predictor needs to see what will touch; mirror images count as in the energy.
        """
        pairs = state.pairs
        apart = np.flatnonzero(pairs.gap > 0.0)
        point, edge, s = pairs.point[apart], pairs.edge[apart], pairs.s[apart]
        nodes = np.concatenate([self.surface.nodes[self.edge[point]], self.surface.nodes[edge]], 1)
        factor = np.concatenate([self._shape[point], -shapes(s)], axis=1)
        values = pairs.normal[apart][:, :, None] * factor[:, None, :]
        count = len(self.surface.rest)
        places = np.concatenate([nodes, nodes + count], axis=1)
        rows = np.repeat(np.arange(len(apart)), 12)
        of_nodes = sp.csr_matrix(
            (values.ravel(), (rows, places.ravel())), shape=(len(apart), 2 * count)
        )
        gaps = [pairs.gap[apart]]
        derivatives = [sp.csr_matrix(of_nodes @ (self._matrix @ extraction))]
        areas = [self.area[point] / 2]
        for plane_rows, gap, movable in zip(
            self._plane_rows, state.plane_gaps, self._apart, strict=True
        ):
            apart = np.flatnonzero(movable & (gap > 0.0))
            gaps.append(2 * gap[apart])
            derivatives.append(sp.csr_matrix(2 * plane_rows[apart] @ extraction))
            areas.append(self.area[apart] / 2)
        return np.concatenate(gaps), sp.vstack(derivatives, format="csr"), np.concatenate(areas)

    def plane_force(self, state: ContactState, name: str) -> float:
        """Total force in N that pushes on the surface from the plane of this name."""
        return float(
            sum(
                self.area @ self.law.pressure(2 * gap)
                for plane, gap in zip(self.planes, state.plane_gaps, strict=True)
                if plane.name == name
            )
        )

    def points(self, positions: FloatArray) -> FloatArray:
        """Deformed points (points, 2) in mm."""
        return np.asarray(self._points @ positions)

    def pressure(self, state: ContactState) -> tuple[FloatArray, float]:
        """Contact pressure at the points in MPa per deformed area, and the area of contact.

        Both half passes act on both surfaces, so a point's pressure is the mean of the nominal one
        on its own and on the opposite undeformed area, each over the area as deformed.
        """
        growth = self.growth(
            self.surface.slopes_at(state.positions, self.s).reshape(-1, 2),
            self.surface.slopes_at(self.surface.rest, self.s).reshape(-1, 2),
            self.points(state.positions),
            self.rest,
        )
        pressure = np.zeros(len(self.edge))
        pairs = state.pairs
        nodes = self.surface.nodes[pairs.edge]
        slope, foot = slopes(pairs.s), shapes(pairs.s)
        x, rest = state.positions[nodes], self.surface.rest[nodes]
        foot_growth = self.growth(
            *(np.einsum("pi,pic->pc", slope, place) for place in (x, rest)),
            *(np.einsum("pi,pic->pc", foot, place) for place in (x, rest)),
        )
        nominal = self.law.pressure(pairs.gap)
        pressure[pairs.point] += nominal / 2 * (1 / growth[pairs.point] + 1 / foot_growth)
        for gap in state.plane_gaps:
            pressure += self.law.pressure(2 * gap) / growth
        return pressure, float((self.area * growth)[pressure > 0.0].sum() / 2)

    def growth(
        self, slope: FloatArray, slope_at_rest: FloatArray, place: FloatArray, rest: FloatArray
    ) -> FloatArray:
        """Deformed over undeformed area at points with these slopes d(x, y)/ds and places."""
        along = np.linalg.norm(slope, axis=1) / np.linalg.norm(slope_at_rest, axis=1)
        width, width_at_rest = self._measure(place), self._measure(rest)
        # On the axis of revolution r / R is dr / dR: a smooth surface is at a right angle to it.
        off_axis = width_at_rest > 1e-9 * width_at_rest.max(initial=0.0)
        around = np.divide(width, width_at_rest, out=along.copy(), where=off_axis)
        return np.asarray(along * around)

    def second_derivative(self, state: ContactState, extraction: sp.csr_matrix) -> sp.csr_matrix:
        """Second derivative by the unknowns of an extraction matrix, both triangles."""
        local, nodes = self._pair_blocks(state)
        count = len(self.surface.rest)
        places = np.concatenate([nodes, nodes + count], axis=1)
        rows = np.repeat(places, 12, axis=1).ravel()
        columns = np.tile(places, 12).ravel()
        of_nodes = sp.csr_matrix((local.ravel(), (rows, columns)), shape=(2 * count, 2 * count))
        mapping = sp.csr_matrix(self._matrix @ extraction)
        total = sp.csr_matrix(mapping.T @ of_nodes @ mapping)
        for plane_rows, gap in zip(self._plane_rows, state.plane_gaps, strict=True):
            touching = np.flatnonzero(gap < 0.0)
            if not len(touching):
                continue
            part = sp.csr_matrix(plane_rows[touching] @ extraction)
            weight = 2 * self.area[touching] * self.law.slope(2 * gap[touching])
            total = total + part.T @ sp.diags_array(weight) @ part
        return sp.csr_matrix(total)

    def _pair_blocks(self, state: ContactState) -> tuple[FloatArray, FloatArray]:
        """Second derivatives (pairs, 12, 12) by x, then y, of the six nodes (pairs, 6).

        With t = x'(s), c = x''(s), n at the foot and a(du) = t . (du_point - du_foot),
        b(du) = n . du'(s), the second variation of the signed distance g is
        ``-[(n.c / t.t) a a + a b + b a + g b b] / (t.t - g n.c)``. At a kink it is the distance
        from a point: ``a a / (g t.t)``, for any t across the normal.
        """
        pairs = state.pairs
        touching = np.flatnonzero(pairs.gap < 0.0)
        point, edge, s = pairs.point[touching], pairs.edge[touching], pairs.s[touching]
        gap, n = pairs.gap[touching], pairs.normal[touching]
        nodes_of_edge = self.surface.nodes[edge]
        x = state.positions[nodes_of_edge]
        t = np.einsum("pi,pic->pc", slopes(s), x)
        c = np.einsum("i,pic->pc", CURVATURES, x)
        tt, nc = (t * t).sum(1), (n * c).sum(1)
        difference = np.concatenate([self._shape[point], -shapes(s)], axis=1)
        turning = np.concatenate([np.zeros((len(s), 3)), slopes(s)], axis=1)

        def rows(vector: FloatArray, factor: FloatArray) -> FloatArray:
            return (vector[:, :, None] * factor[:, None, :]).reshape(-1, 12)

        a, b, gradient = rows(t, difference), rows(n, turning), rows(n, difference)
        ab = a[:, :, None] * b[:, None, :]
        bending = (nc / tt)[:, None, None] * a[:, :, None] * a[:, None, :]
        bending += ab + ab.transpose(0, 2, 1)
        bending += gap[:, None, None] * b[:, :, None] * b[:, None, :]
        bending /= -(tt - gap * nc)[:, None, None]
        kink = pairs.kink[touching]
        across = rows(outward(n[kink]), difference[kink])
        bending[kink] = across[:, :, None] * across[:, None, :] / gap[kink, None, None]
        area = self.area[point] / 2
        local = (area * self.law.slope(gap))[:, None, None] * (
            gradient[:, :, None] * gradient[:, None, :]
        )
        local -= (area * self.law.pressure(gap))[:, None, None] * bending
        nodes = np.concatenate([self.surface.nodes[self.edge[point]], nodes_of_edge], axis=1)
        return local, nodes
