"""What ParaView gets: the whole spring with chi, rho and the displacements."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from ngspring.analysis.forward import control_point_responses
from ngspring.analysis.response import Response
from ngspring.analysis.states import at_control_points, full_displacement
from ngspring.basics.errors import RunFolderError
from ngspring.design.design import Design
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.vtu import write_vtu

N = 8
POINTS = ControlPoint(10, 2), ControlPoint(-10, -2), ControlPoint(10, 2, eta=1.0)
PROBLEM = SpringProblem(POINTS, elements=N, l_i=10.0, H=80.0)


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.column(PROBLEM)


@pytest.fixture(scope="module")
def responses(design: Design) -> dict[float, Response]:
    return control_point_responses(design, [5.0], threads=1)


@pytest.fixture(scope="module")
def mesh(
    design: Design, responses: dict[float, Response], tmp_path_factory: pytest.TempPathFactory
) -> meshio.Mesh:
    path = tmp_path_factory.mktemp("vtu") / "design.vtu"
    write_vtu(path, design, at_control_points(responses, PROBLEM))
    assert [entry.name for entry in path.parent.iterdir()] == ["design.vtu"]
    return meshio.read(path)


def test_names(mesh: meshio.Mesh) -> None:
    assert set(mesh.point_data) == {
        "chi",
        "rho",
        "displacement_10mm",
        "displacement_-10mm",
        "displacement_10mm_eta1",
    }


def test_mesh_covers_the_whole_domain(mesh: meshio.Mesh) -> None:
    assert mesh.points.min(axis=0).tolist() == [0, 0, 0]
    assert mesh.points.max(axis=0).tolist() == [100, 80, 0]
    assert len(mesh.points) == (2 * N + 1) ** 2
    (cells,) = mesh.cells
    assert (cells.type, cells.data.shape) == ("quad", (4 * N**2, 4))


def corners(mesh: meshio.Mesh) -> np.ndarray:
    return np.asarray(mesh.points[mesh.cells[0].data])


def signed_areas(place: np.ndarray) -> np.ndarray:
    first, second = place[:, 2] - place[:, 0], place[:, 3] - place[:, 1]
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2


def test_area_of_rho_is_the_volume(mesh: meshio.Mesh, design: Design) -> None:
    areas = signed_areas(corners(mesh))
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(8000)
    rho = mesh.point_data["rho"][mesh.cells[0].data].mean(axis=1)
    # Trapezoidal rule against nine Gauss points per element.
    assert rho @ areas == pytest.approx(design.volume, rel=2e-3)


def test_chi_and_rho_are_those_of_the_design(mesh: meshio.Mesh, design: Design) -> None:
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    np.testing.assert_allclose(mesh.point_data["chi"], design.chi(x, y), atol=1e-12)
    np.testing.assert_allclose(mesh.point_data["rho"], design.density(x, y), atol=1e-12)


@pytest.mark.parametrize("d", [10.0, -10.0])
def test_displacements_satisfy_the_boundary_conditions(mesh: meshio.Mesh, d: float) -> None:
    u = mesh.point_data[f"displacement_{d:g}mm"]
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    np.testing.assert_allclose(u[y == 80, 1], d, atol=1e-10)
    np.testing.assert_allclose(u[y == 0, 1], 0, atol=1e-10)
    left, right = u[x == 0, 0], u[x == 100, 0]
    assert np.ptp(left) < 1e-10
    np.testing.assert_allclose(right, -left, atol=1e-10)
    assert np.abs(u[:, 0]).max() > 0.01


def test_quarter_is_mirrored_to_what_the_full_domain_gives(
    design: Design, responses: dict[float, Response]
) -> None:
    full = control_point_responses(design, [5.0], domain="full", threads=1)
    for eta, quarter in responses.items():
        for k in range(len(quarter.d)):
            expected = full_displacement(full[eta], k)
            np.testing.assert_allclose(full_displacement(quarter, k), expected, atol=1e-9)


def test_axisymmetric_cross_section(tmp_path: Path) -> None:
    design = Design.column(PROBLEM.replace(kinematics="axisymmetric"))
    response = control_point_responses(design, threads=1)[0.0]
    write_vtu(tmp_path / "a.vtu", design, response)
    mesh = meshio.read(tmp_path / "a.vtu")
    u = mesh.point_data["displacement_-10mm"].reshape(2 * N + 1, 2 * N + 1, 3)
    np.testing.assert_allclose(u[::-1, :, 0], -u[:, :, 0], atol=1e-10)
    np.testing.assert_allclose(u[N, :, 0], 0, atol=1e-10)


def test_folder_missing(tmp_path: Path, design: Design, responses: dict[float, Response]) -> None:
    with pytest.raises(RunFolderError, match="cannot write"):
        write_vtu(tmp_path / "nowhere" / "a.vtu", design, responses)
