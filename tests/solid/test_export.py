"""Files for the workshop, each read back: true size, closed, watertight, one solid."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh
from netgen import occ

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ExportError, OutlineError, ProblemError, RunFolderError
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.export.export import FORMATS, export_body
from ngspring.solid.export.solids import watertight_volume as volume_of
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.outline.levelset import ChiFunction

PLANE = SpringProblem((ControlPoint(-10, -2),), elements=40, T=7.0)
ROUND = PLANE.replace(kinematics="axisymmetric")


def wave(y: FloatArray) -> FloatArray:
    return np.cos(2 * np.pi * y / 100)


def tube(x: FloatArray, y: FloatArray) -> FloatArray:
    return 6 - np.abs(np.abs(x - 50) - 30 - 5 * wave(y))


def spindle(x: FloatArray, y: FloatArray) -> FloatArray:
    return 20 + 5 * wave(y) - np.abs(x - 50)


def stepped(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.maximum(np.minimum(20 - abs(x - 50), 30 - abs(y - 50)), 5 - abs(x - 50))


def true_area(design: Design) -> float:
    body = mesh_body(design, domain="full", max_size=1.0)
    assert body.quality is not None
    return body.quality.area


@pytest.fixture(scope="module")
def area() -> dict[str, float]:
    return {name: true_area(gallery[name]) for name in ("C7", "C7-random")}


def polygon_area(points: FloatArray) -> float:
    x, y = points.T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def off_contour(design: Design, points: FloatArray) -> float:
    """Largest distance in mm of points that are not on the plates from the contour."""
    x, y = np.clip(points, 0, 100).T
    inner = (y > 1e-6) & (y < 100 - 1e-6) & (x > 1e-6) & (x < 100 - 1e-6)
    x, y = x[inner], y[inner]
    slope = np.hypot(design.chi(x, y, (1, 0)), design.chi(x, y, (0, 1)))
    return float(np.abs(design.chi(x, y) / slope).max())


# -- drawings --------------------------------------------------------------------------------------


def svg_loops(path: Path) -> list[FloatArray]:
    """Points along the loops of all paths, y upwards."""
    root = ElementTree.parse(path).getroot()
    height = float(root.attrib["height"].removesuffix("mm"))
    loops: list[FloatArray] = []
    t = np.linspace(0, 1, 21)[1:, None]
    for element in root.iter("{http://www.w3.org/2000/svg}path"):
        for text in element.attrib["d"].split("Z")[:-1]:
            points = np.empty((0, 2))
            for command, numbers in re.findall(r"([MLC])([^MLC]*)", text):
                p = np.array(re.findall(r"-?[\d.]+", numbers), float).reshape(-1, 2)
                if command == "C":
                    a, (b, c, d) = points[-1], p
                    p = (
                        a * (1 - t) ** 3
                        + 3 * b * t * (1 - t) ** 2
                        + 3 * c * t**2 * (1 - t)
                        + d * t**3
                    )
                points = np.vstack([points, p])
            assert np.allclose(points[0], points[-1], atol=1e-6)
            loops.append(points[:-1] * [1, -1] + [0, height])
    return loops


@pytest.mark.parametrize("name", ["C7", "C7-random"])
def test_svg(tmp_path: Path, area: dict[str, float], name: str) -> None:
    design = gallery[name]
    done = export_body(design, tmp_path / "spring.svg")
    assert done.measure == pytest.approx(area[name], rel=1e-4)
    root = ElementTree.parse(done.path).getroot()
    assert root.attrib["width"] == root.attrib["height"] == "100mm"
    assert root.attrib["viewBox"] == "0 0 100 100"
    loops = svg_loops(done.path)
    assert len(loops) == 2
    assert done.parts == (1 if name == "C7" else 2)
    total = sum(map(polygon_area, loops))
    assert total == pytest.approx(area[name], rel=1e-3)
    assert max(off_contour(design, loop) for loop in loops) < 1.1e-3


def test_a_tighter_tolerance_is_kept(tmp_path: Path) -> None:
    design = gallery["C7"]
    export_body(design, tmp_path / "fine.svg", tolerance=1e-5)
    loops = svg_loops(tmp_path / "fine.svg")
    assert max(off_contour(design, loop) for loop in loops) < 1.1e-5


@pytest.mark.parametrize("name", ["C7", "C7-random"])
def test_dxf(tmp_path: Path, area: dict[str, float], name: str) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    design = gallery[name]
    done = export_body(design, tmp_path / "spring.dxf")
    document = ezdxf.readfile(done.path)
    assert document.audit().errors == []
    assert document.units == ezdxf.units.MM
    chains = []
    for entity in document.modelspace():
        if entity.dxftype() == "SPLINE":
            points = np.array([[p.x, p.y] for p in entity.flattening(1e-4)])
        else:
            points = np.array([[p.x, p.y] for p in (entity.dxf.start, entity.dxf.end)])
        chains.append(points)
    total = sum(0.5 * float((p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]).sum()) for p in chains)
    assert total == pytest.approx(area[name], rel=1e-3)
    # Every end of an entity is the beginning of another: the outline is closed.
    starts = {tuple(p[0].round(9)) for p in chains}
    assert starts == {tuple(p[-1].round(9)) for p in chains}
    splines = [p for p in chains if len(p) > 2]
    assert max(off_contour(design, p) for p in splines) < 1.2e-3
    layers = {entity.dxf.layer for entity in document.modelspace()}
    assert len(layers) == done.parts == (1 if name == "C7" else 2)


@pytest.mark.parametrize(("name", "tolerance"), [("C7", 0.01), ("C7", 0.2), ("C7-random", 0.01)])
def test_dxf_as_closed_polylines(
    tmp_path: Path, area: dict[str, float], name: str, tolerance: float
) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    design = gallery[name]
    done = export_body(design, tmp_path / "spring.dxf", tolerance=tolerance, polylines=True)
    document = ezdxf.readfile(done.path)
    assert document.audit().errors == []
    entities = list(document.modelspace())
    assert {(entity.dxftype(), entity.closed) for entity in entities} == {("LWPOLYLINE", True)}
    loops = [np.array(entity.get_points("xy")) for entity in entities]
    assert len(loops) == 2
    assert sum(map(polygon_area, loops)) == pytest.approx(done.measure, rel=1e-12)
    assert done.measure == pytest.approx(area[name], rel=0.05 * tolerance)
    # Chords are within the tolerance all along, and not many times finer.
    t = np.linspace(0, 1, 12)[:-1, None, None]
    chords = [(1 - t) * loop + t * np.roll(loop, -1, axis=0) for loop in loops]
    largest = max(off_contour(design, chord.reshape(-1, 2)) for chord in chords)
    assert tolerance / 4 < largest < 1.1 * tolerance
    layers = {entity.dxf.layer for entity in entities}
    assert len(layers) == done.parts == (1 if name == "C7" else 2)


@pytest.mark.parametrize("polylines", [False, True])
def test_the_header_of_a_dxf_file_says_its_extent(tmp_path: Path, polylines: bool) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    path = export_body(tube, tmp_path / "tube.dxf", problem=PLANE, polylines=polylines).path
    header = ezdxf.readfile(path).header
    # A wall 12 mm thick about |x - 50| = 30 + 5 cos(2 pi y / 100).
    assert header["$EXTMIN"] == pytest.approx((9, 0, 0), abs=0.01)
    assert header["$EXTMAX"] == pytest.approx((91, 100, 0), abs=0.01)


def test_dxf_without_ezdxf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [m for m in sys.modules if m.split(".")[0] == "ezdxf"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ExportError, match=r"pip install 'ngspring\[export\]'"):
        export_body(gallery["C4"], tmp_path / "spring.dxf")
    assert list(tmp_path.iterdir()) == []


# -- solids ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["C7", "C7-random"])
def test_step_of_a_plane_spring(tmp_path: Path, area: dict[str, float], name: str) -> None:
    thick = gallery[name].with_problem(gallery[name].problem.replace(T=12.0))
    done = export_body(thick, tmp_path / "spring.step")
    shape = occ.OCCGeometry(str(done.path)).shape
    solids = 1 if name == "C7" else 2
    assert len(shape.solids) == done.parts == solids
    assert done.measure == pytest.approx(12 * area[name], rel=1e-4)
    assert shape.mass == pytest.approx(12 * area[name], rel=1e-3)
    low, high = shape.bounding_box
    assert (low.z, high.z) == pytest.approx((0, 12), abs=1e-5)
    assert (low.y, high.y) == pytest.approx((0, 100), abs=1e-5)
    assert [file.name for file in tmp_path.iterdir()] == ["spring.step"]


@pytest.mark.parametrize(
    ("chi", "volume"),
    [
        # Pappus: the section 12 mm wide at the mean radius 30 mm; the spindle is full.
        (tube, 2 * np.pi * 30 * 12 * 100),
        (spindle, np.pi * (20**2 + 5**2 / 2) * 100),
    ],
)
def test_solids_of_revolution(tmp_path: Path, chi: ChiFunction, volume: float) -> None:
    step = export_body(chi, tmp_path / "spring.step", problem=ROUND)
    shape = occ.OCCGeometry(str(step.path)).shape
    assert len(shape.solids) == 1
    assert shape.mass == pytest.approx(volume, rel=1e-3)
    assert step.measure == pytest.approx(volume, rel=1e-4)
    stl = export_body(chi, tmp_path / "spring.stl", problem=ROUND)
    points, triangles = welded(stl.path)
    assert watertight_volume(points, triangles) == pytest.approx(volume, rel=1e-3)
    assert np.allclose((points.min(axis=0) + points.max(axis=0)) / 2, [50, 50, 0], atol=0.05)


def watertight_volume(points: FloatArray, triangles: IntArray) -> float:
    return volume_of(trimesh.Trimesh(points, triangles, process=False))


def welded(path: Path) -> tuple[FloatArray, IntArray]:
    """A binary stl with its equal points joined, as any program that reads it must do."""
    mesh = meshio.read(path)
    points, number = np.unique(mesh.points, axis=0, return_inverse=True)
    (cells,) = mesh.cells
    return points.astype(float), number.reshape(-1)[cells.data]


@pytest.mark.parametrize("name", ["C7", "C7-random"])
def test_stl_of_a_plane_spring_is_watertight(
    tmp_path: Path, area: dict[str, float], name: str
) -> None:
    design = gallery[name]
    done = export_body(design, tmp_path / "spring.stl")
    points, triangles = welded(done.path)
    assert watertight_volume(points, triangles) == pytest.approx(area[name], rel=1e-3)
    assert done.measure == pytest.approx(area[name], rel=1e-3)
    assert set(points[:, 2].tolist()) == {0.0, 1.0}
    walls = triangles[np.ptp(points[triangles][:, :, 2], axis=1) > 0]
    # Corners and edge middles of the planes stay within the tolerance of 0.01 mm.
    assert off_contour(design, points[np.unique(walls), :2]) < 1e-2
    p = points[walls][:, :, :2]
    assert off_contour(design, (p[:, [0, 1, 2]] + p[:, [1, 2, 0]]).reshape(-1, 2) / 2) < 1.1e-2


def test_a_surface_with_a_hole_is_noticed() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    closed = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert watertight_volume(points, closed) == pytest.approx(1 / 6)
    with pytest.raises(ExportError, match="not watertight"):
        watertight_volume(points, closed[:3])
    with pytest.raises(ExportError, match="not watertight"):
        watertight_volume(points, np.vstack([closed[:3], closed[3:, ::-1]]))
    with pytest.raises(ExportError, match="inside out"):
        watertight_volume(points, closed[:, ::-1])
    with pytest.raises(ExportError, match="without area"):
        watertight_volume(points * [1, 1, 0] * [1, 0, 1], closed)


@pytest.mark.long
def test_corners_stay_sharp(tmp_path: Path) -> None:
    done = export_body(stepped, tmp_path / "block.step", problem=PLANE)
    shape = occ.OCCGeometry(str(done.path)).shape
    assert shape.mass == pytest.approx(2800 * 7, rel=1e-5)
    loops = svg_loops(export_body(stepped, tmp_path / "block.svg", problem=PLANE).path)
    (loop,) = loops
    for corner in ([30, 20], [70, 80], [45, 0], [45, 20]):
        assert np.hypot(*(loop - corner).T).min() < 2e-3


# -- meshes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["vtu", "msh"])
@pytest.mark.parametrize("name", ["C7", "C7-random"])
def test_meshes(tmp_path: Path, area: dict[str, float], name: str, format: str) -> None:
    done = export_body(gallery[name], tmp_path / f"spring.{format}", max_size=1.5)
    mesh = meshio.read(done.path)
    cells = mesh.cells_dict["triangle6"]
    p = mesh.points[cells][:, :, :2]
    # Green's theorem along the three parabolas of each element.
    total = 0.0
    for a, b, m in ((0, 1, 3), (1, 2, 4), (2, 0, 5)):
        for t, weight in (
            (0.5 - np.sqrt(0.15), 5 / 18),
            (0.5, 8 / 18),
            (0.5 + np.sqrt(0.15), 5 / 18),
        ):
            shape = [(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)]
            slope = [4 * t - 3, 4 * t - 1, 4 - 8 * t]
            q = sum(s * p[:, k] for s, k in zip(shape, (a, b, m), strict=True))
            d = sum(s * p[:, k] for s, k in zip(slope, (a, b, m), strict=True))
            total += float(weight * 0.5 * (q[:, 0] * d[:, 1] - q[:, 1] * d[:, 0]).sum())
    assert total == pytest.approx(done.measure, rel=1e-9)
    assert total == pytest.approx(area[name], rel=1e-3)
    assert done.parts == (1 if name == "C7" else 2)
    if format == "msh":
        assert {"solid", "surface", "bottom", "top"} <= set(mesh.field_data)
        tag = mesh.field_data["bottom"][0]
        chosen = mesh.cell_data_dict["gmsh:physical"]["line3"] == tag
        ends = mesh.points[mesh.cells_dict["line3"][chosen]]
        assert np.abs(ends[:, :, 1]).max() == 0


# -- wrong input -----------------------------------------------------------------------------------


def test_every_format_follows_from_the_suffix_or_the_name(tmp_path: Path) -> None:
    design = gallery["C4"]
    for format in FORMATS[::2]:
        assert export_body(design, tmp_path / f"a.{format.upper()}").format == format
    for format in FORMATS[1::2]:
        assert export_body(design, tmp_path / "b", format).path == tmp_path / "b"


def test_wrong_arguments(tmp_path: Path) -> None:
    design = gallery["C4"]
    with pytest.raises(ExportError, match="did you mean 'step'"):
        export_body(design, tmp_path / "spring.stp")
    with pytest.raises(ExportError, match="use one of svg, dxf"):
        export_body(design, tmp_path / "spring")
    with pytest.raises(ProblemError, match="tolerance = 0"):
        export_body(design, tmp_path / "spring.svg", tolerance=0)
    with pytest.raises(ExportError, match="max_size is an option"):
        export_body(design, tmp_path / "spring.svg", max_size=1)
    with pytest.raises(ExportError, match="polylines is an option"):
        export_body(design, tmp_path / "spring.svg", polylines=True)
    with pytest.raises(RunFolderError, match="cannot write"):
        export_body(design, tmp_path / "missing" / "spring.svg")
    with pytest.raises(OutlineError, match="grey"):
        export_body(Design.column(PLANE), tmp_path / "spring.svg")
    assert list(tmp_path.iterdir()) == []
