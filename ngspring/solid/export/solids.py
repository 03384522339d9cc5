"""Solids of a design: CAD shapes by Open CASCADE (STEP), watertight triangles (STL).

A plane spring is extruded by T from z = 0; an axisymmetric one is revolved about x = L/2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import trimesh
from netgen import occ

from ngspring.basics.errors import ExportError
from ngspring.basics.files import replacing
from ngspring.problem.spring import SpringProblem
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
    return len(parts), _SWEEPS[problem.motion.sweep].volume(parts, problem)


def solid_shape(outline: Outline, parts: list[list[list[SmoothPiece]]]) -> Any:
    """The solid, or a compound of solids, as a shape of netgen.occ in mm."""
    problem, unit = outline.level_set.problem, outline.level_set.unit
    solids = []
    for part in parts:
        # Open CASCADE's tolerances are absolute: it makes the solid in units.
        face = _face(part[0], unit)
        for void in part[1:]:
            face = face - _face(void, unit)
        made = _SWEEPS[problem.motion.sweep].solid(face, problem, unit)
        found = list(made.solids)
        if len(found) != 1 or not found[0].mass > 0:
            raise ExportError(
                f"Open CASCADE made {len(found)} solids of one part of the outline instead of one"
            )
        solids.append(found[0].Scale(occ.Pnt(0, 0, 0), unit))
    return solids[0] if len(solids) == 1 else occ.Compound(solids)


def _face(loop: list[SmoothPiece], unit: float) -> Any:
    return occ.Face(occ.Wire([edge for piece in loop for edge in _edges(piece, unit)]))


def _edges(piece: SmoothPiece, unit: float) -> list[Any]:
    """Edges of Open CASCADE; a spline becomes several that continue each other smoothly.

    Open CASCADE, and programs built on it, integrate over an extruded or revolved face with nine
    Gauss points whatever its length: the volume of a solid with one long wavy face comes out
    several per cent wrong.
    """
    points = [occ.Pnt(x, y, 0) for x, y in (piece.points / unit).tolist()]
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
    problem, unit = outline.level_set.problem, outline.level_set.unit
    sweep = _SWEEPS[problem.motion.sweep]
    # trimesh's tolerances are absolute: it makes the surface in units.
    surface = trimesh.util.concatenate(
        [sweep.triangles(part, problem, tolerance, unit) for part in outline.parts]
    )
    volume = watertight_volume(surface) * unit**3
    surface.apply_scale(unit)
    with replacing(path) as temporary:
        temporary.write_bytes(trimesh.exchange.stl.export_stl(surface))
    return len(outline.parts), volume


def watertight_volume(surface: trimesh.Trimesh) -> float:
    """Volume inside a closed surface of triangles that are oriented outwards.

    Raises
    ------
    ExportError
        If an edge is not shared by exactly two triangles that run along it in opposite
        directions, if a triangle is degenerate, or if the volume is not positive.
    """
    if not (surface.is_watertight and surface.is_winding_consistent):
        raise ExportError("the surface is not watertight: an edge is not shared by two triangles")
    if not (surface.area_faces > 0).all():
        raise ExportError("the surface has a triangle without area")
    if not surface.volume > 0:
        raise ExportError("the surface is inside out")
    return float(surface.volume)


# -- how the solid comes out of the plane ----------------------------------------------------------


@dataclass(frozen=True)
class _Sweep:
    """What `Kinematics.sweep` names: a solid, its volume in mm^3, and its surface of triangles.

    Solid and surface are in the given units of length.
    """

    solid: Callable[[Any, SpringProblem, float], Any]
    volume: Callable[[list[list[list[SmoothPiece]]], SpringProblem], float]
    triangles: Callable[[Part, SpringProblem, float, float], trimesh.Trimesh]


def _extruded(part: Part, problem: SpringProblem, tolerance: float, unit: float) -> trimesh.Trimesh:
    polygon = shapely.Polygon(
        part.outer.polygon / unit, [loop.polygon / unit for loop in part.voids]
    )
    return trimesh.creation.extrude_polygon(polygon, problem.T / unit, engine="earcut")


def _revolved(part: Part, problem: SpringProblem, tolerance: float, unit: float) -> trimesh.Trimesh:
    """The polygon revolved about the line x = L/2, on whose left it lies."""
    axis = problem.L / 2
    radius = axis - min(loop.polygon[:, 0].min() for loop in part.loops)
    steps = max(12, int(np.ceil(np.pi / np.arccos(max(0.5, 1 - tolerance / radius)))))
    surfaces = []
    for loop in part.loops:
        closed = np.vstack([loop.polygon, loop.polygon[:1]])[::-1]
        section = np.column_stack([np.maximum(axis - closed[:, 0], 0.0), closed[:, 1]])
        surfaces.append(trimesh.creation.revolve(section / unit, sections=steps))
    surface = trimesh.util.concatenate(surfaces)
    # From about z to about the line x = axis, parallel to y.
    x, y, z = surface.vertices.T
    surface.vertices = np.column_stack([axis / unit - x, z, y])
    return surface


def _turned(face: Any, problem: SpringProblem, unit: float) -> Any:
    """A face turned about the line x = L/2.

    In two halves: of a whole turn, programs built on Open CASCADE lose the cap at the axis when
    they read a part of less than a centimetre.
    """
    axis = occ.Axis(occ.Pnt(problem.L / 2 / unit, 0, 0), occ.Y)
    half = face.Revolve(axis, 180)
    return half + half.Rotate(axis, 180)


_SWEEPS = {
    "extruded": _Sweep(
        lambda face, problem, unit: face.Extrude(occ.Vec(0, 0, problem.T / unit)),
        lambda parts, problem: enclosed(parts) * problem.T,
        _extruded,
    ),
    "revolved": _Sweep(
        _turned,
        lambda parts, problem: enclosed(parts, axis=problem.L / 2),
        _revolved,
    ),
}
