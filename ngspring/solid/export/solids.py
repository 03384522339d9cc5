"""Solids of a design: CAD shapes by Open CASCADE (STEP), watertight triangles (STL).

A plane spring is extruded by T from z = 0; an axisymmetric one is revolved about x = L/2.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from netgen import occ
from netgen.geom2d import SplineGeometry
from netgen.meshing import MeshingParameters

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ExportError
from ngspring.basics.files import replacing
from ngspring.solid.outline.outline import Outline, Part
from ngspring.solid.outline.smooth import SmoothPiece, enclosed, smooth_loops

_SPANS = 4


def write_step(outline: Outline, path: Path, tolerance: float) -> tuple[int, float]:
    """Write smooth solids; returns their number and volume in mm^3.

    Raises
    ------
    ExportError
        If Open CASCADE cannot make valid solids of the outline.
    """
    parts = smooth_loops(outline, tolerance)
    shape = solid_shape(outline, parts)
    with replacing(path) as temporary:
        shape.WriteStep(str(temporary))
        if not temporary.stat().st_size:
            raise ExportError(f"Open CASCADE could not write {path}")
    problem = outline.level_set.problem
    if problem.motion.axis:
        return len(parts), enclosed(parts, axis=problem.L / 2)
    return len(parts), enclosed(parts) * problem.T


def solid_shape(outline: Outline, parts: list[list[list[SmoothPiece]]]) -> Any:
    """The solid, or a compound of solids, as a shape of netgen.occ."""
    problem = outline.level_set.problem
    solids = []
    for part in parts:
        face = _face(part[0])
        for void in part[1:]:
            face = face - _face(void)
        if problem.motion.axis:
            axis = occ.Axis(occ.Pnt(problem.L / 2, 0, 0), occ.Y)
            made = face.Revolve(axis, 360)
        else:
            made = face.Extrude(occ.Vec(0, 0, problem.T))
        found = list(made.solids)
        if len(found) != 1 or not found[0].mass > 0:
            raise ExportError(
                f"Open CASCADE made {len(found)} solids of one part of the outline instead of one"
            )
        solids.append(found[0])
    return solids[0] if len(solids) == 1 else occ.Compound(solids)


def _face(loop: list[SmoothPiece]) -> Any:
    return occ.Face(occ.Wire([edge for piece in loop for edge in _edges(piece)]))


def _edges(piece: SmoothPiece) -> list[Any]:
    """Edges of Open CASCADE; a spline becomes several that continue each other smoothly.

    Open CASCADE, and programs built on it, integrate over an extruded or revolved face with nine
    Gauss points whatever its length: the volume of a solid with one long wavy face comes out
    several per cent wrong.
    """
    points = [occ.Pnt(x, y, 0) for x, y in piece.points.tolist()]
    if piece.spline is None:
        return [occ.Segment(*points)]
    slopes = piece.spline(piece.parameters, 1).tolist()
    breaks = np.unique(np.linspace(0, len(points) - 1, len(points) // _SPANS + 2).astype(int))
    edges = []
    for a, b in pairwise(breaks.tolist()):
        ends = {0: occ.Vec(*slopes[a], 0), b - a: occ.Vec(*slopes[b], 0)}
        edges.append(occ.SplineInterpolation(points[a : b + 1], tangents=ends))
    return edges


# -- triangles -------------------------------------------------------------------------------------


def write_stl(outline: Outline, path: Path, tolerance: float) -> tuple[int, float]:
    """Write a closed surface of triangles; returns the number of solids and the volume in mm^3.

    The outline's polygon must already be within the tolerance; it decides the angle between
    neighbouring planes of a solid of revolution.

    Raises
    ------
    ExportError
        If the surface is not watertight.
    """
    problem = outline.level_set.problem
    points, triangles, count = [], [], 0
    for part in outline.parts:
        if problem.motion.axis:
            p, t = _revolved(part, problem.L / 2, tolerance)
        else:
            p, t = _extruded(part, problem.T)
        points.append(p)
        triangles.append(t + count)
        count += len(p)
    p, t = np.vstack(points), np.vstack(triangles)
    volume = watertight_volume(p, t)
    with replacing(path) as temporary:
        meshio.write(temporary, meshio.Mesh(p, [("triangle", t)]), "stl", binary=True)
    return len(outline.parts), volume


def watertight_volume(points: FloatArray, triangles: IntArray) -> float:
    """Volume in mm^3 inside a closed surface of triangles that are oriented outwards.

    Raises
    ------
    ExportError
        If an edge is not shared by exactly two triangles that run along it in opposite
        directions, if a triangle is degenerate, or if the volume is not positive.
    """
    a, b = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    n = len(points)
    ahead, behind = np.sort(a * n + b), np.sort(b * n + a)
    if (a == b).any() or (np.diff(ahead) == 0).any() or not np.array_equal(ahead, behind):
        raise ExportError("the surface is not watertight: an edge is not shared by two triangles")
    p = points[triangles]
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    if not (np.linalg.norm(normals, axis=1) > 0).all():
        raise ExportError("the surface has a triangle without area")
    volume = float((p[:, 0] * normals).sum() / 6)
    if not volume > 0:
        raise ExportError(f"the surface encloses a volume of {volume:g} mm^3: it is inside out")
    return volume


def _extruded(part: Part, thickness: float) -> tuple[FloatArray, IntArray]:
    flat, lower = _triangulated(part)
    n = len(flat)
    points = np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (0.0, thickness)])
    a, b = lower.ravel(), lower[:, [1, 2, 0]].ravel()
    # Edges of one triangle only are the outline, with the solid on the left.
    rim = ~np.isin(a * n + b, b * n + a)
    a, b = a[rim], b[rim]
    sides = np.vstack([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    return points, np.vstack([lower[:, ::-1], lower + n, sides])


def _triangulated(part: Part) -> tuple[FloatArray, IntArray]:
    """A coarse triangulation of a part's polygon, counter-clockwise."""
    geometry = SplineGeometry()
    for loop in part.loops:
        numbers = [geometry.AppendPoint(x, y) for x, y in loop.polygon.tolist()]
        for a, b in zip(numbers, [*numbers[1:], numbers[0]], strict=True):
            geometry.Append(["line", a, b], leftdomain=1, rightdomain=0)
    mesh = geometry.GenerateMesh(mp=MeshingParameters(maxh=1e6, grading=0.9))
    points = np.array(mesh.Coordinates())[:, :2]
    triangles = np.array([[p.nr for p in el.vertices] for el in mesh.Elements2D()]) - 1
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    triangles[turned] = triangles[turned][:, ::-1]
    used, inverse = np.unique(triangles, return_inverse=True)
    return points[used], inverse.reshape(-1, 3).astype(np.int64)


def _revolved(part: Part, axis: float, tolerance: float) -> tuple[FloatArray, IntArray]:
    """The polygon revolved about the line x = axis, on whose left it lies."""
    radius = axis - min(loop.polygon[:, 0].min() for loop in part.loops)
    steps = max(12, int(np.ceil(np.pi / np.arccos(max(0.5, 1 - tolerance / radius)))))
    angle = 2 * np.pi * np.arange(steps) / steps
    points: list[FloatArray] = []
    triangles: list[IntArray] = []
    count = 0
    for loop in part.loops:
        polygon = loop.polygon
        on_axis = polygon[:, 0] >= axis
        first = count + np.cumsum(np.where(on_axis, 1, steps)) - np.where(on_axis, 1, steps)
        for (x, y), alone in zip(polygon.tolist(), on_axis, strict=True):
            turns = np.zeros(1) if alone else angle
            r = 0.0 if alone else axis - x
            ring = [axis - r * np.cos(turns), np.full(len(turns), y), r * np.sin(turns)]
            points.append(np.column_stack(ring))
            count += len(turns)
        here = np.arange(steps)
        ahead = (here + 1) % steps
        for k in range(len(polygon)):
            m = (k + 1) % len(polygon)
            if on_axis[k] and on_axis[m]:
                continue
            a, a_next = (first[k] + (0 * s if on_axis[k] else s) for s in (here, ahead))
            b, b_next = (first[m] + (0 * s if on_axis[m] else s) for s in (here, ahead))
            if not on_axis[m]:
                triangles.append(np.column_stack([a, b, b_next]))
            if not on_axis[k]:
                triangles.append(np.column_stack([a, b_next, a_next]))
    return np.vstack(points), np.vstack(triangles).astype(np.int64)
