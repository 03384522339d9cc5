"""Load-displacement curve of a body-fitted solid with real contact (3.5)."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterable
from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from ngspring.analysis.path import Jump, both_ways, checked_displacements, follow, in_order
from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.fem.process import parallel
from ngspring.physics.elasticity import F_33
from ngspring.physics.elasticity import measure as measure_of
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.scaling import force_unit, length_unit
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.contact import Contact, ContactLaw
from ngspring.solid.contact.elasticity import Solid, section_force, side_force, spring_density
from ngspring.solid.contact.mechanics import ContactMechanics, ContactPoint
from ngspring.solid.contact.onset import contact_onset
from ngspring.solid.contact.pressure import excess_of
from ngspring.solid.contact.supports import Supports, spring_supports
from ngspring.solid.contact.surface import free_surface
from ngspring.solid.contact.tunnelling import Skeleton
from ngspring.solid.mesh.body import Body
from ngspring.solid.sides import SURFACE

logger = logging.getLogger(__name__)

#: Accuracy of the displacement where contact starts, in units of H.
_ONSET = 1e-4


@dataclass(frozen=True)
class ContactSettings:
    """Numerical parameters of contact; results do not depend on them within what is tested.

    Parameters
    ----------
    stiffness : float
        Contact stiffness kappa in units of ``(K + 4/3 G) / H``, with no more of K than is carried
        point by point (`ngspring.problem.material.split_bulk_modulus`).
    smoothing : float
        Width epsilon of the contact law's smooth start in units of H.
    points : int
        Points where contact is looked for on each boundary edge.
    solver : str
        See `ngspring.fem.linear.make_factorization`.

    Raises
    ------
    ProblemError
        If a value is out of range.
    """

    stiffness: float = 5e4
    smoothing: float = 1e-5
    points: int = 10
    solver: str = "auto"

    def __post_init__(self) -> None:
        for name in ("stiffness", "smoothing"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and 0.0 < value < np.inf):
                raise ProblemError(f"{name} = {shown(value)} is not valid: it must be positive")
        if not isinstance(self.points, int) or not 3 <= self.points <= 20:
            raise ProblemError(f"points = {shown(self.points)} is not valid: it must be 3 to 20")

    def law(self, problem: SpringProblem) -> ContactLaw:
        """The contact law for a spring's size and material."""
        modulus = split_bulk_modulus(problem.K, problem.G)[0] + 4 / 3 * problem.G
        return ContactLaw(self.stiffness * modulus / problem.H, self.smoothing * problem.H)


@dataclass(frozen=True, eq=False)
class ContactResponse:
    """What a load-displacement analysis with real contact reached.

    Attributes
    ----------
    body : Body
    settings : ContactSettings
    d, q : arrays (points,)
        Displacements in mm, in the order they were asked for, without those that were not reached,
        and forces in N: the total derivative dE/dd.
    q_bottom : array (points,)
        Force on the bottom side, from the reactions there.
    q_stress : array (points,)
        Force carried by the stresses and contact forces through the spring's sections, averaged
        over all of them (`section_force`): q but for rounding in equilibrium.
    q_side : array (points,)
        Integral of the stress over the bottom side (`side_force`), with contact
        there: q but for the error of the mesh.
    energy : array (points,)
        Strain energy in N mm, with the (tiny) energy of contact.
    stiffness : array (points,)
        dq/dd in N/mm.
    u : array (points, 2 ndof)
        Dofs of VectorH1(order=2) on the body's mesh.
    surface_rest : array (surface points, 2)
        Points of the free surface in mm, undeformed, a number of them on each boundary edge.
    surface : array (points, surface points, 2)
        The same, deformed.
    pressure : array (points, surface points)
        Contact pressure there in MPa (force per deformed area), 0 where nothing touches.
    contact_area : array (points,)
        Deformed area of contact in mm^2, of the whole spring, each contact counted once.
    smallest_gap : array (points,)
        In mm, of the surface to itself or to its mirror image, where the surface does not end on
        the mirror line; negative where surfaces overlap, infinite if nothing is near.
    largest_stretch : array (points,)
        Largest principal stretch.
    stretch_measure : array (points,)
        The principal stretch that a thousandth of the solid's volume exceeds: unlike the largest
        one, which is that of a point, it converges with the mesh.
    largest_stretch_at : array (points, 2)
        Its place in the undeformed solid in mm.
    contact_starts : tuple of float
        Displacements d in mm where contact starts, at most one for compression and one for
        tension, by bisection to H / 10000 unless another accuracy was asked for.
    complete : bool
        Whether every displacement that was asked for was reached.
    message : str
        Where and why the path ended, if it did.
    iterations : int
        Newton iterations in all.
    jumps : tuple of Jump
        Where a branch ended on the way and the solid snapped to another one.
    """

    body: Body
    settings: ContactSettings
    d: FloatArray
    q: FloatArray
    q_bottom: FloatArray
    q_stress: FloatArray
    q_side: FloatArray
    energy: FloatArray
    stiffness: FloatArray
    u: FloatArray
    surface_rest: FloatArray
    surface: FloatArray
    pressure: FloatArray
    contact_area: FloatArray
    smallest_gap: FloatArray
    largest_stretch: FloatArray
    largest_stretch_at: FloatArray
    stretch_measure: FloatArray
    contact_starts: tuple[float, ...] = ()
    complete: bool = True
    message: str = ""
    iterations: int = 0
    jumps: tuple[Jump, ...] = ()


@dataclass
class _Watch:
    """Counts iterations and notes between which two points contact starts."""

    mechanics: ContactMechanics
    last: ContactPoint
    iterations: int = 0
    onset: tuple[ContactPoint, ContactPoint] | None = None

    def __call__(self, point: ContactPoint) -> None:
        self.iterations += point.iterations + 1
        if self.onset is None and self.mechanics.touching(point):
            self.onset = self.last, point
        self.last = point


def contact_mechanics(
    body: Body, settings: ContactSettings, threads: int = 1
) -> tuple[ContactMechanics, Supports]:
    """The spring of a body, ready for `ngspring.analysis.path.follow`."""
    problem = body.problem
    supports = spring_supports(body)
    solid = Solid(
        body.mesh,
        spring_density(body),
        supports.extraction.matrix,
        supports.floating,
        lambda u: F_33(u, problem),
        measure_of(problem),
        excess_of(problem),
    )

    def measure(places: FloatArray) -> FloatArray:
        return np.broadcast_to(problem.measure(places[:, 0]), len(places))

    contact = Contact(
        free_surface(body.mesh, SURFACE),
        supports.planes,
        settings.law(problem),
        measure,
        settings.points,
    )
    skeleton = Skeleton(body.mesh, SURFACE, length_unit(problem))
    mechanics = ContactMechanics(
        solid, contact, skeleton, problem.H, force_unit(problem), settings.solver, threads
    )
    return mechanics, supports


def contact_load_displacement(
    body: Body,
    displacements: Iterable[float],
    *,
    settings: ContactSettings | None = None,
    threads: int | None = None,
    onset: float = _ONSET,
) -> ContactResponse:
    """Equilibrium of a body-fitted solid with frictionless contact at prescribed displacements.

    Contact of every part of the free surface with every other, with itself, and with the mirror
    planes at the sides of the meshed part. The path is followed from the undeformed state in both
    directions with adaptive steps; where it cannot be followed any further, what was reached is
    returned with a message.

    Parameters
    ----------
    body : Body
    displacements : iterable of float
        Displacements d in mm, in any order, which is that of the results; 0 is allowed.
    settings : ContactSettings, optional
    threads : int, optional
        All available ones by default.
    onset : float
        Accuracy of `contact_starts` as a share of H. The search takes up to half of the time; with
        ``math.inf`` it is the middle of the step in which contact starts, for nothing.

    Returns
    -------
    ContactResponse

    Raises
    ------
    ProblemError
        If a displacement is not a finite number smaller than H in size, the solid does not reach
        the loaded sides, or the IPC Toolkit is not installed.
    """
    settings = ContactSettings() if settings is None else settings
    targets = checked_displacements(displacements, body.problem)
    with parallel(threads) as count:
        mechanics, supports = contact_mechanics(body, settings, count)
        rest = mechanics.at_rest()
        points = [rest]
        messages, starts, iterations = [], [], rest.iterations + 1
        jumps: list[Jump] = []
        for side in both_ways(targets):
            watch = _Watch(mechanics, rest)
            reached, message = follow(mechanics, side, rest, on_point=watch, on_jump=jumps.append)
            points += reached
            iterations += watch.iterations
            if watch.onset is not None:
                starts.append(contact_onset(mechanics, *watch.onset, onset * body.problem.H))
            if message:
                logger.warning(message)
                messages.append(message)
        points = in_order(targets, points)
        response = _response(body, settings, mechanics, supports, points)
    return dataclasses.replace(
        response,
        contact_starts=tuple(sorted(starts)),
        complete=not messages,
        message="; ".join(messages),
        iterations=iterations,
        jumps=tuple(jumps),
    )


def _response(
    body: Body,
    settings: ContactSettings,
    mechanics: ContactMechanics,
    supports: Supports,
    points: list[ContactPoint],
) -> ContactResponse:
    """The rows of these points."""
    solid, contact = mechanics.solid, mechanics.contact
    n, m = solid.ndof, len(contact.rest)
    fields = [mechanics.full_field(point.d, point.u) for point in points]
    height = ng.GridFunction(ng.H1(body.mesh, order=2))
    height.Set(ng.y)
    stretch = np.append(np.zeros(n), height.vec.FV().NumPy() / body.problem.H)
    rows = [
        _evaluated(body, mechanics, supports, stretch, point, full)
        for point, full in zip(points, fields, strict=True)
    ]
    return ContactResponse(
        body=body,
        settings=settings,
        d=np.array([point.d for point in points]),
        q=np.array([point.q for point in points]),
        q_bottom=np.array([row[0] for row in rows]),
        q_stress=np.array([row[1] for row in rows]),
        q_side=np.array([row[6] for row in rows]),
        energy=np.array([point.energy for point in points]),
        stiffness=np.array([point.stiffness for point in points]),
        u=np.array(fields).reshape(-1, 2 * n),
        surface_rest=contact.rest,
        surface=np.array([contact.points(point.contact.positions) for point in points]).reshape(
            -1, m, 2
        ),
        pressure=np.array([row[2] for row in rows]).reshape(-1, m),
        contact_area=np.array([row[3] for row in rows]),
        smallest_gap=np.array([point.contact.smallest_gap for point in points]),
        largest_stretch=np.array([row[4] for row in rows]),
        largest_stretch_at=np.array([row[5] for row in rows]).reshape(-1, 2),
        stretch_measure=np.array([solid.stretch_measure(full) for full in fields]),
    )


def _evaluated(
    body: Body,
    mechanics: ContactMechanics,
    supports: Supports,
    stretch: FloatArray,
    point: ContactPoint,
    full: FloatArray,
) -> tuple[float, float, FloatArray, float, float, tuple[float, float], float]:
    """q_bottom, q_stress, pressures, contact area, largest stretch and its place, q_side."""
    solid, contact = mechanics.solid, mechanics.contact
    of_contact = contact.forces(point.contact)
    forces = solid.forces(full) + of_contact
    on_bottom = forces[supports.bottom].sum() + contact.plane_force(point.contact, "bottom")
    q_stress = section_force(body, solid, full) + float(of_contact @ stretch)
    pressure, area = contact.pressure(point.contact)
    largest, place = solid.largest_stretch(full)
    from_plane = supports.top_share * contact.plane_force(point.contact, "bottom")
    q_side = side_force(body, solid, full, "bottom") - from_plane
    q_bottom = -supports.top_share * float(on_bottom)
    return q_bottom, q_stress, pressure, area, largest, place, q_side
