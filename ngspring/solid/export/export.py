"""Files a workshop can use: drawings, CAD solids, surfaces for printing, meshes.

Everything is in mm and true size, for the whole spring: a plane spring is extruded by its
thickness T, an axisymmetric one revolved about its axis, the line x = L/2 parallel to y.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import shapely

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import nearest, shown
from ngspring.basics.errors import ExportError, ProblemError
from ngspring.basics.files import PathLike, replacing
from ngspring.design.design import Design
from ngspring.problem.scaling import length_unit
from ngspring.problem.spring import SpringProblem
from ngspring.solid.export.solids import write_step, write_stl
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.mesh.triangles import NAMES
from ngspring.solid.outline.levelset import ChiFunction, owner
from ngspring.solid.outline.outline import Outline, outline
from ngspring.solid.outline.smooth import enclosed, smooth_loops

logger = logging.getLogger(__name__)

FORMATS = ("svg", "dxf", "step", "stl", "vtu", "msh")
#: Angle between neighbouring points from which curves are fitted, in rad.
_FIRST_ANGLE = 0.25


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    path : Path
    format : str
    parts : int
        Separate parts (solids in a step or stl file, outlines in a drawing).
    measure : float
        Area in mm^2 of a drawing or mesh (of an axisymmetric spring: of its section through the
        axis, of a mesh the half of it), volume in mm^3 of a solid.
    """

    path: Path
    format: str
    parts: int
    measure: float


def export_body(
    design: Design | ChiFunction,
    path: PathLike,
    format: str | None = None,
    *,
    problem: SpringProblem | None = None,
    level: float = 0.0,
    tolerance: float | None = None,
    polylines: bool = False,
    smallest_island: float | None = None,
    smallest_void: float | None = None,
    **mesh_options: Any,
) -> Exported:
    """Write the solid {chi > level} of a design as a drawing, a solid, a surface or a mesh.

    Parameters
    ----------
    design : Design or callable
        See `ngspring.solid.mesh.mesh_body.mesh_body`.
    path : path
        Written atomically.
    format : {"svg", "dxf", "step", "stl", "vtu", "msh"}, optional
        By default what the suffix of the path says. svg: filled cubic Bezier paths. dxf: SPLINE
        and LINE, or LWPOLYLINE entities, one layer per part (needs
        ``pip install 'ngspring[export]'``). step: one solid, or a compound of them, with smooth
        faces. stl: watertight triangles. vtu, msh: the second-order mesh of `mesh_body`.
    problem : SpringProblem, optional
        Needed for a function.
    level : float
        ``-8 o / l_i`` moves the surface of a finished design outwards by o mm.
    tolerance : float, optional
        Largest distance in mm of the written curve or surface from the contour of chi; by default
        1e-5 of sqrt(L H), for stl 1e-4.
    polylines : bool
        Whether a dxf file holds closed polylines instead of splines and lines.
    smallest_island, smallest_void
        See `ngspring.solid.outline.outline.outline`.
    **mesh_options
        Options of `mesh_body` for vtu and msh.

    Returns
    -------
    Exported

    Raises
    ------
    ExportError
        If the format is unknown, or ezdxf is not installed.
    OutlineError
        If the design has no clear outline.
    RunFolderError
        If the file cannot be written.
    """
    path = Path(path)
    chosen = (path.suffix.removeprefix(".") if format is None else format).lower()
    if chosen not in FORMATS:
        hint = f" (did you mean {nearest(chosen, FORMATS)!r}?)" if chosen else ""
        raise ExportError(
            f"{shown(chosen or str(path))} is not a format of export:"
            f" use one of {', '.join(FORMATS)}{hint}"
        )
    problem = owner(design, problem)
    if tolerance is None:
        tolerance = (1e-2 if chosen == "stl" else 1e-3) * length_unit(problem)
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise ProblemError(f"tolerance = {shown(tolerance)} must be a positive length in mm")
    if polylines and chosen != "dxf":
        raise ExportError("polylines is an option of the format dxf")
    if mesh_options and chosen not in ("vtu", "msh"):
        raise ExportError(f"{next(iter(mesh_options))} is an option of the formats vtu and msh")
    small: dict[str, Any] = {"smallest_island": smallest_island, "smallest_void": smallest_void}
    if chosen in ("vtu", "msh"):
        return _write_mesh(design, path, chosen, problem, level, small | mesh_options)
    if chosen == "stl" or polylines:
        spacing = min(problem.L, problem.H) / 100
        angle = 8 * tolerance / spacing
    else:
        spacing = min(problem.L, problem.H) / 25
        angle = _FIRST_ANGLE
    if chosen in ("svg", "dxf"):
        design, problem = _SECTIONS[problem.motion.sweep](design, problem)
    edges = outline(
        design, problem, level=level, domain="full", spacing=spacing, angle=angle, **small
    )
    if len(edges.parts) > 1:
        logger.info("%s: the spring consists of %d separate parts", path, len(edges.parts))
    return (_write_polylines if polylines else _WRITERS[chosen])(edges, path, tolerance)


def _as_drawn(
    design: Design | ChiFunction, problem: SpringProblem
) -> tuple[Design | ChiFunction, SpringProblem]:
    return design, problem


def _both_halves(
    design: Design | ChiFunction, problem: SpringProblem
) -> tuple[Design | ChiFunction, SpringProblem]:
    """The section on both sides of the axis, as if it were plane."""
    plane = problem.replace(kinematics="plane strain")
    if isinstance(design, Design):
        return design, plane
    chi: ChiFunction = design

    def folded(x: FloatArray, y: FloatArray) -> FloatArray:
        return chi(np.minimum(x, plane.L - x), y)

    return folded, plane


#: What a drawing shows, by `Kinematics.sweep`.
_SECTIONS = {"extruded": _as_drawn, "revolved": _both_halves}


def _write_svg(edges: Outline, path: Path, tolerance: float) -> Exported:
    problem = edges.level_set.problem
    parts = smooth_loops(edges, tolerance)
    # Coordinates are rounded far below the tolerance; y points down in SVG.
    digits = max(0, int(np.ceil(-np.log10(tolerance))) + 2)

    def at(p: FloatArray) -> str:
        return f"{p[0]:.{digits}f},{problem.H - p[1]:.{digits}f}"

    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" version="1.1" width="{problem.L:.10g}mm"'
        f' height="{problem.H:.10g}mm" viewBox="0 0 {problem.L:.10g} {problem.H:.10g}">',
    ]
    for part in parts:
        commands = []
        for loop in part:
            commands.append(f"M {at(loop[0].points[0])}")
            for piece in loop:
                if piece.spline is None:
                    commands.append(f"L {at(piece.points[-1])}")
                else:
                    commands += ["C " + " ".join(map(at, b[1:])) for b in piece.beziers()]
            commands.append("Z")
        lines.append(f'<path fill="#404040" fill-rule="evenodd" d="{" ".join(commands)}"/>')
    with replacing(path) as temporary:
        temporary.write_text("\n".join([*lines, "</svg>", ""]), encoding="utf-8")
    return Exported(path, "svg", len(parts), enclosed(parts))


def _write_dxf(edges: Outline, path: Path, tolerance: float) -> Exported:
    """Splines and lines."""
    parts = smooth_loops(edges, tolerance)
    document = _drawing(edges)
    space = document.modelspace()
    for k, part in enumerate(parts, 1):
        layer = f"PART{k}"
        for piece in (piece for loop in part for piece in loop):
            if piece.spline is None:
                a, b = piece.points.tolist()
                space.add_line(a, b, dxfattribs={"layer": layer})
                continue
            curve = space.add_spline(degree=int(piece.spline.k), dxfattribs={"layer": layer})
            points = [(x, y, 0.0) for x, y in piece.spline.c.tolist()]
            curve.control_points = points
            curve.knots = piece.spline.t.tolist()
            closed = bool((piece.points[0] == piece.points[-1]).all())
            # Flag 1, closed; flag 8, planar. The knots are clamped, so it is not periodic.
            curve.dxf.flags = (1 if closed else 0) | 8
    with replacing(path) as temporary:
        document.saveas(temporary)
    return Exported(path, "dxf", len(parts), enclosed(parts))


def _write_polylines(edges: Outline, path: Path, tolerance: float) -> Exported:
    """A closed polyline for each loop."""
    parts = [
        [np.vstack([piece.points[:-1] for piece in loop]) for loop in part]
        for part in smooth_loops(edges, tolerance, degree=1)
    ]
    document = _drawing(edges)
    for k, part in enumerate(parts, 1):
        for loop in part:
            document.modelspace().add_lwpolyline(
                loop.tolist(), close=True, dxfattribs={"layer": f"PART{k}"}
            )
    with replacing(path) as temporary:
        document.saveas(temporary)
    area = sum(shapely.Polygon(outer, voids).area for outer, *voids in parts)
    return Exported(path, "dxf", len(parts), area)


def _drawing(edges: Outline) -> Any:
    """An empty drawing of ezdxf in mm with its extent and a layer for each part."""
    try:
        from ezdxf import units
        from ezdxf.document import Drawing
    except ImportError:
        raise ExportError("the format dxf needs ezdxf: pip install 'ngspring[export]'") from None
    document = Drawing.new("R2010")
    document.units = units.MM
    points = np.vstack([loop.polygon for loop in edges.loops])
    corners = ((*corner.tolist(), 0.0) for corner in (points.min(axis=0), points.max(axis=0)))
    # Of the layout, from which ezdxf takes those of the header.
    document.modelspace().reset_extents(*corners)
    for k in range(1, len(edges.parts) + 1):
        document.layers.add(f"PART{k}")
    return document


def _write_mesh(
    design: Design | ChiFunction,
    path: Path,
    format: str,
    problem: SpringProblem,
    level: float,
    options: dict[str, Any],
) -> Exported:
    body = mesh_body(design, problem, level=level, domain="full", **options)
    mesh = body.triangles
    assert mesh is not None
    assert body.quality is not None
    points = np.column_stack([mesh.points, np.zeros(len(mesh.points))])
    cells: list[Any] = [("triangle6", mesh.triangles)]
    if format == "vtu":
        data = meshio.Mesh(points, cells)
    else:
        names = [*NAMES, "solid"]
        tags = [np.full(len(mesh.triangles), len(names), np.int32)]
        for k in np.unique(mesh.names):
            cells.append(("line3", mesh.segments[mesh.names == k]))
            tags.append(np.full(len(cells[-1][1]), k + 1, np.int32))
        data = meshio.Mesh(
            points,
            cells,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={
                name: np.array([k, 2 if name == "solid" else 1]) for k, name in enumerate(names, 1)
            },
        )
    with replacing(path) as temporary:
        if format == "vtu":
            meshio.write(temporary, data, file_format="vtu")
        else:
            meshio.write(temporary, data, file_format="gmsh22", binary=False)
    return Exported(path, format, mesh.parts, body.quality.area)


def _write_step(edges: Outline, path: Path, tolerance: float) -> Exported:
    solids, volume = write_step(edges, path, tolerance)
    return Exported(path, "step", solids, volume)


def _write_stl(edges: Outline, path: Path, tolerance: float) -> Exported:
    solids, volume = write_stl(edges, path, tolerance)
    return Exported(path, "stl", solids, volume)


_WRITERS: dict[str, Callable[[Outline, Path, float], Exported]] = {
    "svg": _write_svg,
    "dxf": _write_dxf,
    "step": _write_step,
    "stl": _write_stl,
}
