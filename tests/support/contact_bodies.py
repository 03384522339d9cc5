"""Bodies that the tests of contact share, meshed from CAD shapes."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from netgen.occ import Axes, Glue, MoveTo, OCCGeometry, WorkPlane, X, Z
from netgen.occ import Circle as Disc

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.grid import Grid
from ngspring.physics.elasticity import strain_energy
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.contact import Contact, ContactLaw
from ngspring.solid.contact.elasticity import Solid
from ngspring.solid.contact.mechanics import ContactMechanics
from ngspring.solid.contact.supports import Plane
from ngspring.solid.contact.surface import free_surface
from ngspring.solid.contact.tunnelling import Skeleton
from ngspring.solid.mesh.body import Body


def spring(**changes: Any) -> SpringProblem:
    return SpringProblem((ControlPoint(-20.0, -5.0),), **changes)


def rectangle(x: float, y: float, width: float, height: float) -> Any:
    return MoveTo(x, y).Rectangle(width, height).Face()


def ellipse(x: float, y: float, a: float, b: float) -> Any:
    return WorkPlane(Axes((x, y, 0), Z, X)).Ellipse(a, b).Face()


def meshed(shape: Any, maxh: float) -> Any:
    mesh = ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=maxh))
    mesh.Curve(2)
    return mesh


def body_of(shape: Any, maxh: float, problem: SpringProblem) -> Body:
    """A body with its boundary pieces named by where they lie."""
    width, height = Grid(problem).size
    for edge in shape.edges:
        low, high = edge.bounding_box
        edge.name = "surface"
        for name, axis, place in (
            ("left", 0, 0.0),
            ("right", 0, width),
            ("bottom", 1, 0.0),
            ("top", 1, height),
        ):
            ends = ((low.x, high.x), (low.y, high.y))[axis]
            if max(abs(end - place) for end in ends) < 1e-4:
                edge.name = name
    return Body(problem, meshed(shape, maxh))


def block_with_hole(maxh: float = 5.0, a: float = 30.0, b: float = 4.0, **changes: Any) -> Body:
    """A block that fills the domain, with an elliptic hole in the middle."""
    problem = spring(**changes)
    width, height = Grid(problem).size
    shape = rectangle(0, 0, width, height) - ellipse(problem.L / 2, problem.H / 2, a, b)
    return body_of(shape, maxh, problem)


def nearest_vertex(mesh: Any, x: float, y: float) -> int:
    points = np.array([v.point for v in mesh.vertices])
    k = int(np.argmin(np.hypot(points[:, 0] - x, points[:, 1] - y)))
    assert np.hypot(*(points[k] - (x, y))) < 1e-9
    return k


def constrained(n: int, fixed: IntArray, driven: FloatArray) -> sp.csr_matrix:
    """Dofs <- free unknowns and d, where ``driven . dofs = d`` and some dofs are zero."""
    driven = driven.copy()
    driven[fixed] = 0.0
    k = int(np.argmax(np.abs(driven)))
    held = np.zeros(2 * n, bool)
    held[fixed] = True
    held[k] = True
    free = np.flatnonzero(~held)
    rows = np.concatenate([free, np.full(len(free), k), [k]])
    columns = np.concatenate([np.arange(len(free)), np.arange(len(free)), [len(free)]])
    values = np.concatenate([np.ones(len(free)), -driven[free] / driven[k], [1 / driven[k]]])
    matrix = sp.csr_matrix((values, (rows, columns)), shape=(2 * n, len(free) + 1))
    matrix.eliminate_zeros()
    return matrix


def mechanics_of(
    mesh: Any,
    matrix: sp.csr_matrix,
    law: ContactLaw,
    size: float,
    planes: tuple[Plane, ...] = (),
) -> ContactMechanics:
    """Any solid of the default material, 1 mm thick, with contact of its "surface"."""
    problem = spring()
    solid = Solid(mesh, lambda u, grad_u: strain_energy(u, grad_u, problem), matrix)
    contact = Contact(free_surface(mesh, "surface"), planes, law, lambda x: np.ones(len(x)))
    return ContactMechanics(solid, contact, Skeleton(mesh, "surface"), size, force=1.0)


def two_blocks(gap: float = 0.05, sizes: tuple[float, float] = (1.3, 0.9)) -> Any:
    """Two blocks of 10 x 5 mm one above the other, with elements of these sizes."""
    lower, upper = rectangle(0, 0, 10, 5), rectangle(0, 5 + gap, 10, 5)
    lower.maxh, upper.maxh = sizes
    for block, low, high in ((lower, "bottom", "surface"), (upper, "surface", "top")):
        for edge in block.edges:
            low_end, high_end = edge.bounding_box
            flat = high_end.y - low_end.y < 1e-4
            at_left = high_end.x < 1e-4
            middle = block.center.y
            side = low if edge.center.y < middle else high
            edge.name = side if flat else "left" if at_left else "surface"
    from netgen.occ import Compound

    return meshed(Compound([lower, upper]), 5.0)


def half_cylinder(radius: float, near: float, maxh: float) -> Any:
    """The right half of the lower half of a cylinder that stands on y = 0, fine where it does."""
    quarter = Disc((0, radius), radius).Face() * rectangle(0, 0, radius, radius)
    fine = quarter * Disc((0, 0), near).Face()
    fine.maxh = near / 16
    shape = Glue([quarter - Disc((0, 0), near).Face(), fine])
    for edge in shape.edges:
        low, high = edge.bounding_box
        on_arc = abs(np.hypot(edge.center.x, edge.center.y - radius) - radius) < 0.02 * radius
        edge.name = "surface" if on_arc else "inside"
        if max(abs(low.x), abs(high.x)) < 1e-4:
            edge.name = "left"
        elif max(abs(low.y - radius), abs(high.y - radius)) < 1e-4:
            edge.name = "top"
    return meshed(shape, maxh)
