"""Body-fitted meshes of second-order triangles (3.5, Fig. 12).

The boundary is divided by local thickness and curvature into edges whose ends and middles lie on
the contour of chi itself; Netgen fills the inside. The quarter is meshed and mirrored, so that a
full mesh is exactly symmetric.
"""

from __future__ import annotations

import logging
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from netgen.geom2d import SplineGeometry
from netgen.meshing import MeshingParameters
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.design.design import Design
from ngspring.problem.spring import SpringProblem
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.quality import MeshQuality, layers_across, quality_of
from ngspring.solid.mesh.triangles import TriangleMesh, mirrored, to_ngsolve
from ngspring.solid.mesh.wallsize import Boundary, Sizes, graded, survey
from ngspring.solid.outline.levelset import ChiFunction, LevelSet, is_symmetric, owner
from ngspring.solid.outline.outline import Outline, outline
from ngspring.solid.sides import SURFACE

Mask: TypeAlias = NDArray[np.bool_]

logger = logging.getLogger(__name__)

_ATTEMPTS = 4


def mesh_body(
    design: Design | ChiFunction,
    problem: SpringProblem | None = None,
    *,
    level: float = 0.0,
    domain: str | None = None,
    elements_across: int = 4,
    angle: float = 0.08,
    min_size: float | None = None,
    max_size: float | None = None,
    smallest_island: float | None = None,
    smallest_void: float | None = None,
) -> Body:
    """Mesh the solid {chi > level} with curved second-order triangles.

    Parameters
    ----------
    design : Design or callable
        A design, or a vectorised function chi(x, y) of x, y in mm from the lower left corner of
        the full domain.
    problem : SpringProblem, optional
        Size, kinematics and material; needed for a function.
    level : float
        ``-8 o / l_i`` moves the surface of a finished design outwards by o mm (2.6).
    domain : {"quarter", "full"}, optional
        Part that is meshed; by default the quarter if chi is symmetric about both axes, else the
        full domain. The full mesh of a symmetric chi consists of mirrored copies.
    elements_across : int
        Fewest elements between the two faces of a wall, counted in edges from node to node.
    angle : float
        Largest turn of the surface within an element in rad. It decides when the ends of slits
        crease and touch themselves: with 0.12 C4 carries 1.1 % more at d = -10 mm, just before its
        slit closes, with 0.07 0.02 % less.
    min_size, max_size : float, optional
        Bounds of the element size in mm; by default 1/2000 and 1/60 of the smaller side of the
        domain. Walls thinner than `elements_across` times `min_size` get fewer elements.
    smallest_island, smallest_void
        See `ngspring.solid.outline.outline.outline`.

    Returns
    -------
    Body
        With its `quality`.

    Raises
    ------
    ProblemError
        If an argument is out of range.
    OutlineError
        If the design is empty, full, grey or not connected, or cannot be meshed.
    """
    if isinstance(elements_across, bool) or not isinstance(elements_across, int | np.integer):
        raise ProblemError(f"elements_across = {shown(elements_across)} must be an integer")
    if elements_across < 1:
        raise ProblemError(f"elements_across = {elements_across} must be at least 1")
    problem = owner(design, problem)
    symmetric = isinstance(design, Design) or is_symmetric(design, problem)
    part = "quarter" if symmetric else domain
    solid = outline(
        design,
        problem,
        level=level,
        domain=part,
        smallest_island=smallest_island,
        smallest_void=smallest_void,
    )
    ls = solid.level_set
    extent = min(ls.problem.L, ls.problem.H)
    smallest = extent / 2000 if min_size is None else min_size
    largest = extent / 60 if max_size is None else max_size
    for name, value in (("min_size", smallest), ("max_size", largest), ("angle", angle)):
        if not (np.isfinite(value) and value > 0):
            raise ProblemError(f"{name} = {shown(value)} must be a positive number")
    if smallest > largest:
        raise ProblemError(f"min_size = {smallest:g} must not exceed max_size = {largest:g}")
    sizes = Sizes(elements_across, angle, smallest, largest)
    boundary = survey(solid)
    mesh, across = _mesh_with_walls(solid, boundary, sizes)
    if domain == "full" and ls.problem.domain != domain:
        mesh = mirrored(mesh, ls.problem.sector)
        body_problem = ls.problem.replace(domain="full")
        area = solid.area * len(mesh.triangles) / mesh.quarter_elements
    else:
        body_problem, area = ls.problem, solid.area
    quality = quality_of(mesh, area, across, boundary)
    _check(quality)
    return Body(body_problem, to_ngsolve(mesh), ls.level, quality, mesh)


def _check(quality: MeshQuality) -> None:
    if quality.smallest_jacobian <= 0:
        raise OutlineError(
            "the surface is too strongly curved for the elements on it: an element is turned"
            f" inside out (Jacobian ratio {quality.smallest_jacobian:.3g}); use a smaller angle"
        )


def _mesh_with_walls(solid: Outline, boundary: Boundary, sizes: Sizes) -> tuple[TriangleMesh, int]:
    """Mesh, count the elements across walls, and refine walls that have too few."""
    refine = np.ones(len(boundary.points))
    for attempt in range(_ATTEMPTS):
        mesh = _generate(solid.level_set, boundary, sizes, refine)
        walls = layers_across(mesh, boundary, solid.level_set)
        # Where the smallest size is reached nothing can be refined.
        size = sizes.along(boundary, refine)
        poor = (walls > 0) & (walls < sizes.across) & (size > sizes.smallest)
        logger.debug("mesh %d: %d elements, %d poor", attempt, len(mesh.triangles), poor.sum())
        if not poor.any() or attempt == _ATTEMPTS - 1:
            break
        near = _near(boundary.points, poor, 2 * boundary.thickness)
        refine = np.where(near, refine * 0.8, refine)
    return mesh, int(walls[walls > 0].min(initial=np.iinfo(np.int64).max))


def _near(points: FloatArray, marked: Mask, reach: FloatArray) -> Mask:
    result = np.zeros(len(points), bool)
    for k in np.flatnonzero(marked).tolist():
        result |= np.hypot(*(points - points[k]).T) <= reach[k]
    return result


def _generate(ls: LevelSet, boundary: Boundary, sizes: Sizes, refine: FloatArray) -> TriangleMesh:
    size = graded(boundary.points, sizes.along(boundary, refine), sizes.grading)
    geometry = SplineGeometry()
    # Netgen's tolerances are absolute: it sees everything in units.
    parameters = MeshingParameters(maxh=sizes.largest / ls.unit, grading=sizes.grading)
    first = {}
    for k, piece in enumerate(boundary.pieces):
        mine = np.flatnonzero(boundary.piece == k)
        nodes = _divided(ls, boundary.points[mine], size[mine], piece.name)
        numbers = []
        for x, y in (nodes / ls.unit).tolist():
            if (x, y) not in first:
                first[x, y] = geometry.AppendPoint(x, y)
            numbers.append(first[x, y])
        for a, b in pairwise(numbers):
            geometry.Append(["line", a, b], leftdomain=1, rightdomain=0, bc=piece.name)
    _restrict(parameters, boundary, size, sizes.inside(boundary, refine), ls.unit)
    geometry.SetMaterial(1, "solid")
    try:
        mesh = geometry.GenerateMesh(mp=parameters)
    except Exception as error:
        # NgException has no base class of its own.
        raise OutlineError(f"Netgen could not mesh the solid: {error}") from None
    return TriangleMesh.from_netgen(mesh, ls)


def _divided(ls: LevelSet, points: FloatArray, size: FloatArray, name: str) -> FloatArray:
    """Nodes along a piece, spaced by the size, on the contour."""
    gap = np.linalg.norm(np.diff(points, axis=0), axis=1)
    place = np.concatenate([[0.0], np.cumsum(2 * gap / (size[1:] + size[:-1]))])
    closed = bool((points[0] == points[-1]).all())
    count = max(int(np.ceil(place[-1])), 6 if closed else 1)
    wanted = np.linspace(0, place[-1], count + 1)[1:-1]
    inner = np.column_stack([np.interp(wanted, place, points[:, k]) for k in (0, 1)])
    if name == SURFACE:
        after = np.clip(np.searchsorted(place, wanted), 1, len(place) - 1)
        moved, reached = ls.approach(inner, reach=gap[after - 1])
        inner = np.where(reached[:, None], moved, points[after])[
            reached | (after < len(points) - 1)
        ]
    return np.vstack([points[:1], inner, points[-1:]])


def _restrict(
    parameters: MeshingParameters,
    boundary: Boundary,
    size: FloatArray,
    inside: FloatArray,
    unit: float,
) -> None:
    """Give Netgen the size on the boundary and, where it is a wall's, inside the wall."""
    for (x, y), h in zip((boundary.points / unit).tolist(), (size / unit).tolist(), strict=True):
        parameters.RestrictH(x=x, y=y, z=0.0, h=h)
    for k in np.flatnonzero(boundary.opposite >= 0).tolist():
        for share in (0.25, 0.5):
            place = boundary.points[k] + share * boundary.thickness[k] * boundary.normals[k]
            x, y, h = (float(value) / unit for value in (*place, inside[k]))
            parameters.RestrictH(x=x, y=y, z=0.0, h=h)
