"""Pictures: complete files, right scales and labels, deformed as the fields say."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.image import imread

import ngspring
from ngspring.analysis.forward import control_point_responses
from ngspring.analysis.response import Response
from ngspring.analysis.states import (
    curve_displacements,
    full_displacement,
    interpolation,
)
from ngspring.basics.errors import NgspringError, RunFolderError
from ngspring.design.design import Design
from ngspring.design.history import History
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.curves import response_figure
from ngspring.view.figure import new_figure, save_figure
from ngspring.view.rows import design_figure
from ngspring.view.run import convergence_figure

POINTS = ControlPoint(20, 4), ControlPoint(-10, -2), ControlPoint(20, 4, eta=1.0)
PROBLEM = SpringProblem(POINTS, name="mine", elements=8, l_i=10.0)


def rows() -> History:
    base = {"newton_iterations": 3.0, "rejected": 0.0, "rejected_iterations": 0.0, "V": 1.0}
    forces = {"C_q1": 1e-3, "C_q2": 0.0, "C_q3": 1e-9, "q1": 4.0, "q2": -2.0, "q3": 4.0}
    return History.from_rows(
        [
            {"update": float(k), "dt": dt, "C": 0.1, "width": 0.5, "seconds": 1.0, **base, **forces}
            for k, dt in enumerate((0.0, 1.0, 1e10, np.inf))
        ]
    )


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.column(PROBLEM)


@pytest.fixture(scope="module")
def responses(design: Design) -> dict[float, Response]:
    return control_point_responses(design, curve_displacements(design, points=4), threads=1)


@pytest.fixture(scope="module")
def row(design: Design, responses: dict[float, Response]) -> Figure:
    return design_figure(design, responses, responses[0.0])


def nothing_cut_off(figure: Figure) -> bool:
    figure.canvas.draw()
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return bool(box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height)


def test_design_row_titles(row: Figure, design: Design, responses: dict[float, Response]) -> None:
    titles = [axes.get_title() for axes in row.axes]
    assert titles[0] == f"mine\nW/H = {design.equivalent_width / 100:.4f}"
    assert titles[1].startswith("d = 20 mm\nq = ")
    assert titles[1].endswith("N (target 4)")
    assert titles[2].startswith("d = -10 mm\nq = -")
    assert titles[3].startswith("d = 20 mm, η = 1\n")
    assert titles[4] == ""
    assert (row.axes[-1].get_xlabel(), row.axes[-1].get_ylabel()) == ("d [mm]", "q [N]")


def test_design_row_has_one_scale_and_nothing_is_cut_off(row: Figure) -> None:
    assert nothing_cut_off(row)
    panels = row.axes[:-1]
    limits = {(axes.get_xlim(), axes.get_ylim()) for axes in panels}
    assert len(limits) == 1
    for axes in panels:
        assert axes.get_aspect() == 1.0
        box = axes.get_window_extent()
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert box.height / box.width == pytest.approx((high - low) / (right - left), rel=1e-6)


def test_deformed_mesh_is_drawn_where_the_field_says(
    row: Figure, responses: dict[float, Response]
) -> None:
    response = responses[0.0]
    index = int(np.argmin(response.d))
    u = full_displacement(response, index)
    (drawn,) = [c for c in row.axes[2].collections if isinstance(c, QuadMesh)]
    coordinates = drawn.get_coordinates()
    fine = (coordinates.shape[0] - 1) // 16
    place = coordinates[::fine, ::fine]
    x = np.linspace(0, 100, 17)
    np.testing.assert_allclose(place[..., 0], x[:, None] + u[0], atol=1e-9)
    np.testing.assert_allclose(place[..., 1], x[None, :] + u[1], atol=1e-9)
    np.testing.assert_allclose(coordinates[:, -1, 1], 100 + response.d[index], atol=1e-9)


def test_void_is_not_drawn() -> None:
    design = Design.from_function(PROBLEM, lambda x, y: np.where(x < 30, -9.0, 9.0))
    response = control_point_responses(design, threads=1)[0.0]
    figure = design_figure(design, response, response)
    (drawn,) = [c for c in figure.axes[0].collections if isinstance(c, QuadMesh)]
    cells = np.ma.masked_invalid(drawn.get_array())
    assert 0.3 < cells.count() / ngspring.view.design.CELLS**2 < 0.6
    assert cells.count() > 0.9 * cells.size
    # The axes hold the void, too.
    assert figure.axes[0].dataLim.bounds == (0.0, 0.0, PROBLEM.L, PROBLEM.H)
    # The robust control point has no response of its own here.
    assert figure.axes[3].get_title().endswith("not reached")


def test_axisymmetric_row(tmp_path: Path) -> None:
    design = Design.column(PROBLEM.replace(kinematics="axisymmetric", L=160.0))
    responses = control_point_responses(design, threads=1)
    figure = design_figure(design, responses, responses[0.0])
    assert "D/H = " in figure.axes[0].get_title()
    assert nothing_cut_off(figure)


def test_convergence_figure() -> None:
    figure = convergence_figure(rows(), PROBLEM)
    dt, C, C_q, width = figure.axes
    assert [axes.get_yscale() for axes in figure.axes] == ["log", "log", "log", "linear"]
    assert width.get_ylabel() == "V as W/H"
    assert width.get_xlabel() == "design update"
    assert [text.get_text() for text in dt.texts] == ["dt = ∞"]
    names = [text.get_text() for text in C_q.get_legend().get_texts()]
    assert names == ["d = 20 mm", "d = -10 mm", "d = 20 mm, η = 1"]
    assert nothing_cut_off(figure)
    assert C.get_ylabel() == "C"


def test_convergence_figure_of_one_row() -> None:
    history = rows()
    first = History(history.columns, history.values[:1])
    assert nothing_cut_off(convergence_figure(first, PROBLEM))


def test_response_figure(responses: dict[float, Response]) -> None:
    figure = response_figure(responses[0.0], PROBLEM)
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert names == ["response", "target", "target, offset chi"]
    assert nothing_cut_off(figure)


def test_save_figure(tmp_path: Path, responses: dict[float, Response]) -> None:
    figure = response_figure(responses[0.0], PROBLEM)
    for name in ("a.png", "b.pdf", "c.svg"):
        save_figure(figure, tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.pdf", "c.svg"]
    assert imread(tmp_path / "a.png").shape[:2] == (608, 800)


def test_save_figure_refuses(tmp_path: Path) -> None:
    with pytest.raises(NgspringError, match="suffix of a picture"):
        save_figure(new_figure(1, 1), tmp_path / "a.nonsense")
    with pytest.raises(RunFolderError, match="cannot write"):
        save_figure(new_figure(1, 1), tmp_path / "nowhere" / "a.png")


def test_interpolation_reproduces_quadratics() -> None:
    t = np.linspace(0, 3, 50)
    nodes = np.linspace(0, 3, 7)
    np.testing.assert_allclose(interpolation(3, t) @ (nodes**2 - nodes), t**2 - t, atol=1e-12)


def test_no_graphical_backend_is_touched() -> None:
    code = "import sys, ngspring.view.design; sys.exit('matplotlib.pyplot' in sys.modules)"
    folder = Path(ngspring.__file__).parents[1]
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=folder).returncode == 0
