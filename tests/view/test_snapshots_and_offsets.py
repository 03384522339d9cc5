"""Figs. 15 and 16: what an offset of chi does, and a design on its way."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from netgen.geom2d import unit_square

import ngspring
import ngspring.view.design
from ngspring import Design
from ngspring.physics.chi import stiffness
from ngspring.problem.scaling import on_mesh
from ngspring.view.design import offsets_figure
from ngspring.view.rows import snapshots_figure


def test_ramp_is_the_stiffness_that_is_solved_with(rough: Design) -> None:
    chi = np.array([-300.0, -7.0, -0.3, 0.0, 4.0, 60.0])
    mesh = ng.Mesh(unit_square.GenerateMesh(maxh=1))
    solved = [stiffness(ng.CF(value), rough.problem)(mesh(0.5, 0.5)) for value in chi]
    np.testing.assert_allclose(stiffness(chi, rough.problem), solved, rtol=1e-12)
    drawn = offsets_figure(np.arange(6.0), chi, rough.problem, (-1.0, 1.0)).axes[2].lines
    np.testing.assert_allclose(drawn[1].get_ydata(), stiffness(chi + 1, rough.problem))


def test_snapshots_figure_shows_the_updates_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ngspring.view.design, "CELLS", 8)
    small = on_mesh(ngspring.cases["C7"], 8)[0]
    runs = {"a": dict.fromkeys((0, 5, 9), Design.column(small)), "b": {}}
    titles = [axes.get_title().split("\n")[0] for axes in snapshots_figure(runs, (0,)).axes]
    assert titles == ["a, update 0", "a, update 9", "b"]
