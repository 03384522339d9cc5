"""The similar part has the similar answer: from a micrometre to a kilometre, from 1 Pa to 1 TPa.

Every analysis and every file of a design, in units of the domain (`length_unit`) and of its
material (`force_unit`), against the same of the spring of 100 mm and 1 MPa.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
from netgen import occ

from ngspring.analysis.forward import load_displacement
from ngspring.analysis.stability import stability
from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.evolution.optimize import optimize
from ngspring.fem.taylor import taylor_test
from ngspring.kkt.stationarity import optimality
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import force_unit, length_unit, scaled
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.plausibility import check_targets
from ngspring.solid.export.export import export_body
from ngspring.solid.outline.outline import outline
from ngspring.solid.tolerance import tolerance
from ngspring.solid.verification import verify

#: Factors of length and stress: both ends of both, with forces from 1e-16 to 1e14 N.
CHANGES = [(1e-5, 1e-6), (1e4, 1e6)]
#: Netgen may divide the similar solid into other triangles: a last digit tips its choice.
MESH = 5e-4
SHARES = np.array([-0.12, -0.06, 0.08])
POINTS = ControlPoint(8.0, 0.5), ControlPoint(-12.0, -0.5)


def bowed(x: FloatArray, y: FloatArray) -> FloatArray:
    """Two columns 16 mm thick that bow outwards from the middle of the loaded sides."""
    x, y = np.minimum(x, 100 - x), np.minimum(y, 100 - y)
    centre = 46 - 30 * np.sin(np.pi * y / 100)
    return np.asarray(1.2 * (8.0 - abs(x - centre)))


def design(kinematics: str) -> Design:
    problem = SpringProblem(POINTS, elements=16, l_i=5.0, kinematics=kinematics)
    return Design.from_function(problem, bowed)


def similar(spring: Design, length: float, stress: float) -> Design:
    problem = scaled(spring.problem, length=length, stress=stress)
    return dataclasses.replace(spring, problem=problem)


@dataclasses.dataclass(frozen=True)
class Units:
    """Millimetres and newtons of a spring, and where its curve is looked at."""

    mm: float
    N: float
    d: FloatArray

    @classmethod
    def of(cls, spring: Design) -> Units:
        problem = spring.problem
        return cls(length_unit(problem), force_unit(problem), SHARES * problem.H)


def third_medium(spring: Design, units: Units, folder: Path) -> list[float]:
    response = load_displacement(spring, units.d, threads=1)
    assert response.complete
    return [*(response.q / units.N), *(response.energy / (units.N * units.mm))]


def real_contact(spring: Design, units: Units, folder: Path) -> list[float]:
    outcome = verify(spring, units.d, threads=1)
    assert outcome.complete
    forces = (outcome.contact.q, outcome.third_medium.q)
    return [
        *(q / units.N for curve in forces for q in curve),
        outcome.smallest_wall / units.mm,
        outcome.largest_stretch[0],
        *(d / units.mm for d in outcome.contact.contact_starts),
    ]


def eigenvalues(spring: Design, units: Units, folder: Path) -> list[float]:
    outcome = stability(spring, units.d, threads=1)
    assert outcome.complete
    return [*outcome.relative, *(x for c in outcome.critical for x in (c.d / units.mm,))]


def offsets(spring: Design, units: Units, folder: Path) -> list[float]:
    outcome = tolerance(spring, (0.5 * units.mm,), points=2, threads=1)
    curves = [curve.contact for curve in outcome.curves if curve.contact is not None]
    assert len(curves) == 3
    levels = [curve.level for curve in outcome.curves]
    return [*levels, *(q / units.N for curve in curves for q in curve.q)]


def objective(spring: Design, units: Units, folder: Path) -> list[float]:
    """Three design updates on a coarse mesh, and the residuals of what they end with."""
    problem = spring.problem
    coarse = problem.replace(elements=8, l_i=2 * problem.l_i)
    result = optimize(coarse, max_updates=3, threads=1)
    assert len(result.history) == 4
    found = optimality(result.design, threads=1)
    counts = result.history.newton_iterations
    return [*(np.array(result.q) / units.N), result.history.last().C, counts, found.residual]


def derivative(spring: Design, units: Units, folder: Path) -> list[float]:
    """q is the derivative of the energy by d, and dq/dd its second one."""

    def at(d: FloatArray) -> tuple[float, float, float]:
        response = load_displacement(spring, [float(d[0]) * units.mm], threads=1)
        values = response.energy[0], response.q[0] * units.mm, response.stiffness[0] * units.mm**2
        energy, q, stiffness = (float(value / (units.N * units.mm)) for value in values)
        return energy, q, stiffness

    test = taylor_test(
        lambda d: at(d)[0],
        lambda d: np.array([at(d)[1]]),
        np.array([4.0]),
        np.array([8.0]),
        lambda d, v: at(d)[2] * v,
        steps=(0.1, 0.05),
    )
    return [test.first_order, test.second_order]


def plausibility(spring: Design, units: Units, folder: Path) -> list[float]:
    findings = check_targets(spring.problem)
    return [float(len(findings)), *(float(finding.level == "error") for finding in findings)]


ANALYSES: dict[str, tuple[Callable[[Design, Units, Path], list[float]], float]] = {
    "load-displacement curve": (third_medium, 1e-9),
    "verify": (real_contact, MESH),
    "stability": (eigenvalues, 1e-6),
    "tolerance": (offsets, MESH),
    "optimize": (objective, 1e-5),
    "taylor": (derivative, 1e-3),
    "check of the targets": (plausibility, 0.0),
}


@pytest.fixture(scope="module")
def reference() -> dict[tuple[str, str], list[float]]:
    return {}


@pytest.mark.long
@pytest.mark.parametrize(("length", "stress"), CHANGES)
@pytest.mark.parametrize("analysis", ANALYSES)
def test_every_analysis_of_the_similar_spring_is_similar(
    analysis: str,
    length: float,
    stress: float,
    kinematics: str,
    reference: dict[tuple[str, str], list[float]],
    tmp_path: Path,
) -> None:
    run, accuracy = ANALYSES[analysis]
    spring = design(kinematics)
    if (analysis, kinematics) not in reference:
        reference[analysis, kinematics] = run(spring, Units.of(spring), tmp_path)
    right = np.array(reference[analysis, kinematics])
    other = similar(spring, length, stress)
    found = np.array(run(other, Units.of(other), tmp_path))
    assert found.shape == right.shape
    np.testing.assert_allclose(found, right, rtol=accuracy, atol=accuracy * np.abs(right).max())


# -- files, as somebody else reads them ------------------------------------------------------------


def of_svg(path: Path) -> FloatArray:
    """All coordinates of the paths in mm."""
    return np.array(re.findall(r"-?[\d.]+", "".join(re.findall(r' d="([^"]+)"', path.read_text()))))


def of_dxf(path: Path) -> FloatArray:
    """Control points of all splines, ends of all lines, and the drawing's extent, in mm."""
    document = pytest.importorskip("ezdxf").readfile(path)
    assert document.audit().errors == []
    numbers: list[float] = [*document.header["$EXTMIN"], *document.header["$EXTMAX"]]
    for entity in document.modelspace():
        spline = entity.dxftype() == "SPLINE"
        points = entity.control_points if spline else (entity.dxf.start, entity.dxf.end)
        numbers += [value for point in points for value in tuple(point)[:2]]
    return np.array(numbers)


def of_polylines(path: Path) -> FloatArray:
    document = pytest.importorskip("ezdxf").readfile(path)
    loops = [entity.get_points("xy") for entity in document.modelspace()]
    return np.array([value for loop in loops for point in loop for value in point])


def of_stl(path: Path) -> FloatArray:
    """Cube root of the volume, and two corners, in mm."""
    mesh = meshio.read(path)
    a, b, c = (np.asarray(mesh.points[mesh.cells[0].data[:, k]], float) for k in range(3))
    volume = float((a * np.cross(b, c)).sum()) / 6
    return np.array([volume ** (1 / 3), *mesh.points.min(axis=0), *mesh.points.max(axis=0)])


def of_step(path: Path) -> FloatArray:
    """Cube root of the volume, and the middle of the box around it, in mm."""
    shape = occ.OCCGeometry(str(path)).shape
    low, high = shape.bounding_box
    assert len(shape.solids) == 1
    return np.array([shape.mass ** (1 / 3), (low.x + high.x) / 2, (low.y + high.y) / 2])


def of_mesh(path: Path) -> FloatArray:
    """Root of the area, and two corners, in mm."""
    mesh = meshio.read(path)
    a, b, c = (mesh.points[mesh.cells_dict["triangle6"][:, k], :2] for k in range(3))
    u, v = (b - a).T, (c - a).T
    area = float((u[0] * v[1] - u[1] * v[0]).sum()) / 2
    return np.array([area**0.5, *mesh.points.min(axis=0)[:2], *mesh.points.max(axis=0)[:2]])


FILES: dict[str, tuple[str, dict[str, bool], Callable[[Path], FloatArray]]] = {
    "svg": ("svg", {}, of_svg),
    "dxf": ("dxf", {}, of_dxf),
    "polylines": ("dxf", {"polylines": True}, of_polylines),
    "stl": ("stl", {}, of_stl),
    "step": ("step", {}, of_step),
    "vtu": ("vtu", {}, of_mesh),
    "msh": ("msh", {}, of_mesh),
}


@pytest.mark.long
@pytest.mark.parametrize("file", FILES)
def test_every_file_of_the_similar_spring_is_similar_and_in_mm(
    file: str, kinematics: str, tmp_path: Path
) -> None:
    format, options, read = FILES[file]
    spring = design(kinematics)
    right = export_body(spring, tmp_path / f"right.{format}", **options)
    values = read(right.path).astype(float)
    for length, stress in CHANGES:
        done = export_body(
            similar(spring, length, stress), tmp_path / f"similar.{format}", **options
        )
        found = read(done.path).astype(float) / length
        assert done.parts == right.parts
        assert done.measure == pytest.approx(
            right.measure * length ** (3 if format in ("stl", "step") else 2), rel=1e-6
        )
        assert found.shape == values.shape
        # Drawings are written to 1e-5 of these units, and STL holds seven digits.
        assert np.abs(found - values).max() < MESH


@pytest.mark.parametrize("length", [1e-5, 1e-3, 1e4])
def test_a_hole_is_judged_by_its_share_of_the_domain(length: float) -> None:
    """C7's is 1.4 % of the domain, and was filled where that was less than 1e-3 mm^2."""
    solid = outline(similar(gallery["C7"], length, 1.0), domain="full")
    assert solid.filled == ()
    assert len(solid.loops) == 2
    problem = solid.level_set.problem
    assert solid.area / (problem.L * problem.H) == pytest.approx(0.2528, abs=1e-4)
