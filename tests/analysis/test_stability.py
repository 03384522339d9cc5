"""Buckling out of the symmetry: Euler's column, mirrored states, inertia, the command."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.sparse as sp
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.linalg import eigh
from support.designs import rough_coefficients

from ngspring.analysis.mechanics import Mechanics
from ngspring.analysis.modes import FullTangent, mirrored
from ngspring.analysis.path import follow
from ngspring.analysis.stability import ZERO, Stability, stability
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.cli.main import cli
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.linear import inertia
from ngspring.problem.material import bulk_and_shear_modulus
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.stability import stability_figure

PARDISO = importlib.util.find_spec("pypardiso") is not None


def column(width: float = 10.0, elements: int = 12, L: float = 40.0, d: float = -4.0) -> Design:
    """A straight column in void that hardly helps it to stay straight."""
    problem = SpringProblem((ControlPoint(d, 1.0),), elements=elements, L=L, k_r=1e-8)

    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        steep = 8 / problem.h_x * (width / 2 - np.abs(x - L / 2))
        return np.clip(steep, -10, 10) + 0 * y

    return Design.from_function(problem, chi)


class Euler(NamedTuple):
    d: float
    q: float


def euler(design: Design) -> Euler:
    """Euler's load in plane strain and the displacement at which the column carries it.

    Top and bottom stay horizontal and u_x is the same on both: two clamped ends without sway,
    effective length H/2, deflection 1 - cos(2 pi y / H). The column is a composite of layers of
    stiffness E(chi).
    """
    problem = design.problem
    x = np.linspace(0, problem.L, 4001)
    rho = design.density(x, problem.H / 2)
    stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
    area = np.mean(stiffness) * problem.L
    inertia = np.mean(stiffness * (x - problem.L / 2) ** 2) * problem.L
    K, G, H = problem.K, problem.G, problem.H
    young, nu = 9 * K * G / (3 * K + G), (3 * K - 2 * G) / (2 * (3 * K + G))
    load = 4 * np.pi**2 * young / (1 - nu**2) * problem.T * inertia / H**2
    strain = 4 * np.pi**2 * inertia / (area * H**2)
    return Euler(-float(strain * H), -float(load))


@pytest.fixture(scope="module")
def slender() -> tuple[Design, Stability]:
    design = column()
    return design, stability(design, [-3.0, -2.0, -1.0, 0.0, 2.5], threads=1)


def test_a_slender_column_buckles_at_eulers_load(slender: tuple[Design, Stability]) -> None:
    design, outcome = slender
    expected = euler(design)
    assert -3.0 < expected.d < -2.0
    (critical,) = outcome.critical
    assert critical.d == pytest.approx(expected.d, rel=0.1)
    assert critical.q == pytest.approx(expected.q, rel=0.1)
    assert -3.0 <= min(critical.bracket) <= critical.d <= max(critical.bracket) <= -2.0
    assert np.ptp(critical.bracket) <= 1.0
    assert abs(critical.mode.eigenvalue) < 0.005
    assert not outcome.stable
    assert not outcome.spring_stable
    assert outcome.complete


def test_its_mode_is_the_one_of_clamped_ends(slender: tuple[Design, Stability]) -> None:
    design, outcome = slender
    mode = outcome.critical[0].mode
    assert mode.kind == "solid"
    assert mode.shares[0] > 0.95
    assert sum(mode.shares) == pytest.approx(1)
    assert mode.symmetry == ("antisymmetric", "symmetric")
    assert "antisymmetric in x, symmetric in y" in mode.symmetry_text
    # Along the axis: a cosine, and any sideways shift of the whole.
    axis = mode.nodes[0, design.problem.elements]
    y = np.linspace(0, 1, len(axis))
    deflection = axis - axis[0]
    expected = (1 - np.cos(2 * np.pi * y)) / 2 * deflection[len(axis) // 2]
    np.testing.assert_allclose(deflection, expected, atol=0.05 * np.abs(deflection).max())


def test_its_stiffness_falls_in_proportion_to_the_load(slender: tuple[Design, Stability]) -> None:
    design, outcome = slender
    assert outcome.d.tolist() == [-3.0, -2.0, -1.0, 0.0, 2.5]
    compressed = outcome.d <= 0
    linear = 1 - outcome.q[compressed] / euler(design).q
    np.testing.assert_allclose(outcome.relative[compressed], linear, atol=0.05)
    verdicts = [point.verdict for point in outcome.points]
    assert verdicts == ["unstable", "stable", "stable", "stable", "stable"]


def test_at_rest_and_in_tension_it_is_stable(slender: tuple[Design, Stability]) -> None:
    _, outcome = slender
    assert outcome.rest == pytest.approx(1, rel=1e-3)
    tension = outcome.points[-1]
    assert tension.d == 2.5
    assert tension.lowest > 0.5
    assert not any(critical.d > 0 for critical in outcome.critical)


def test_inertia_counts_the_negative_eigenvalues(slender: tuple[Design, Stability]) -> None:
    _, outcome = slender
    assert [point.negative for point in outcome.points] == [1, 0, 0, 0, 0]
    for point in outcome.points:
        assert sum(mode.eigenvalue < 0 for mode in point.modes) == point.negative


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
def test_a_stout_block_does_not_buckle(kinematics: str) -> None:
    problem = SpringProblem((ControlPoint(-20.0, -1.0),), elements=6, kinematics=kinematics)
    outcome = stability(Design.from_function(problem, lambda x, y: 10 + 0 * x), threads=1)
    assert len(outcome.points) >= 9
    assert {0.0, -20.0} < set(outcome.d)
    assert outcome.stable
    assert (outcome.relative > 0.3).all()
    assert all(point.verdict == "stable" for point in outcome.points)
    assert max(point.imbalance for point in outcome.points) < 1e-10


def test_the_mirrored_state_is_in_equilibrium_on_the_full_domain(kinematics: str) -> None:
    problem = SpringProblem(
        (ControlPoint(-9.0, 1.0),), kinematics=kinematics, elements=12, L=90.0, H=110.0
    )
    coefficients = 0.8 * rough_coefficients(problem).ravel()
    part, whole = (ScalarSpace(Grid(problem.replace(domain=name))) for name in ("quarter", "full"))
    quarter = Mechanics(part, spline_extraction(part) @ coefficients)
    full = Mechanics(whole, spline_extraction(whole) @ coefficients)
    states, message = follow(quarter, np.array([-4.0, -12.0]))
    assert message == ""
    for state in states:
        field = mirrored(part, whole, quarter.full_field(state.d, state.u), state.d)
        u = full.images.restrict(field)
        np.testing.assert_array_equal(full.full_field(state.d, u), field)
        forces = full.forces(state.d, u)
        assert np.linalg.norm(forces[:-1]) < 1e-10 * abs(state.q)
        assert forces[-1] == pytest.approx(state.q, rel=1e-10)


# -- eigenvalues ---------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["sparsecholesky", "pardiso"])
def test_lowest_eigenvalues_are_those_of_the_dense_matrices(solver: str) -> None:
    if solver == "pardiso" and not PARDISO:
        pytest.skip("pypardiso is not installed")
    design = column(elements=6, L=30.0)
    part, whole = (
        ScalarSpace(Grid(design.problem.replace(domain=name))) for name in ("quarter", "full")
    )
    quarter = Mechanics(part, spline_extraction(part) @ design.coefficients.ravel())
    chi = spline_extraction(whole) @ design.coefficients.ravel()
    tangent = FullTangent(whole, chi, 0.0, solver, 1)
    states, _ = follow(quarter, np.array([-1.0, -4.0, -12.0]))
    seen = []
    for state in states:
        field = mirrored(part, whole, quarter.full_field(state.d, state.u), state.d)
        u = tangent.body.images.restrict(field)
        values, vectors, negative = tangent.lowest(state.d, u, 4)
        K = tangent.body.tangent.toarray()
        M = tangent.mass.toarray()
        exact = eigh(K, M, eigvals_only=True)
        count = int((exact < -ZERO).sum())
        seen.append(count)
        assert int((values < 0).sum()) == count
        assert negative == inertia(sp.csr_matrix(K)) == count
        # Sylvester: the metric does not change how many are negative.
        assert int((np.linalg.eigvalsh(K) < 0).sum()) == count
        np.testing.assert_allclose(values, exact[: len(values)], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(vectors.T @ M @ vectors, np.eye(len(values)), atol=1e-3)
    assert seen[0] == 0
    assert seen[-1] > seen[1] >= 1


@pytest.mark.long
def test_a_failing_third_medium_is_not_the_springs_buckling() -> None:
    # Two stout legs carry the load; between them stands a slender strip of grey.
    problem = SpringProblem((ControlPoint(-4.0, -1.0),), elements=12, L=60.0, k_r=1e-10)

    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        away = np.abs(x - 30.0) / problem.h_x
        return np.where(away < 1.5, -1.0, np.where(away > 2.9, 10.0, -10.0)) + 0 * y

    design = Design.from_function(problem, chi)
    outcome = stability(design, [-4.0, -1.0], threads=1)
    assert outcome.d.tolist() == [-4.0, -1.0]
    assert outcome.rest == pytest.approx(1, rel=1e-3)
    assert outcome.points[0].verdict == "unstable"
    assert not outcome.stable
    assert outcome.spring_stable
    (critical,) = outcome.critical
    assert critical.mode.kind in ("grey", "void")
    assert critical.mode.shares[0] < 1e-2
    # The spring's own lowest mode is still there, and far from zero.
    solid = next(mode for mode in outcome.points[0].modes if mode.kind == "solid")
    assert solid.eigenvalue > 0.5
    assert isinstance(stability_figure(design, outcome), Figure)


# -- paths that end, arguments, command ----------------------------------------------------------


@pytest.mark.long
def test_a_path_that_ends_is_reported() -> None:
    problem = SpringProblem((ControlPoint(-10.0, 1.0),), elements=8)
    design = Design(problem, rough_coefficients(problem))
    outcome = stability(design, [-95.0, -2.0], threads=1)
    assert not outcome.complete
    assert "the path ends at d = -" in outcome.message
    assert outcome.d.tolist() == [-2.0]


def test_arguments_are_checked() -> None:
    design = column(elements=4)
    for arguments in ({"displacements": [150.0]}, {"displacements": []}, {"modes": 0}):
        with pytest.raises(ProblemError):
            stability(design, **arguments)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match="eta"):
        stability(design, [1.0], eta=float("nan"))


@pytest.mark.parametrize("buckles", [True, False])
def test_the_command_tells_and_draws(buckles: bool, tmp_path: Path) -> None:
    design = column(elements=8, d=-3.5) if buckles else column(elements=8, d=2.0)
    design.save(tmp_path / "column.npz")
    arguments = ["stability", str(tmp_path / "column.npz"), "--points", "2", "--threads", "1"]
    folder = tmp_path / "pictures"
    result = CliRunner().invoke(cli, [*arguments, "--out", str(folder)])
    assert result.exit_code == 0, result.output
    if buckles:
        assert "unstable in compression from d = -2." in result.output
        assert "the spring's" in result.output
        assert "antisymmetric in x, symmetric in y" in result.output
    else:
        assert "the symmetric path is stable from d = 0 to 2 mm" in result.output
    height, width, _ = imread(folder / "stability.png").shape
    assert width > height > 300


@pytest.mark.slow
def test_c4_sways_when_its_hole_closes() -> None:
    outcome = stability(gallery["C4"])
    assert outcome.complete
    assert max(point.imbalance for point in outcome.points) < 1e-10
    (critical,) = outcome.critical
    assert critical.d == pytest.approx(-14.4, abs=0.3)
    assert critical.q == pytest.approx(-2.82, abs=0.05)
    assert critical.mode.kind == "solid"
    assert critical.mode.symmetry == ("antisymmetric", "antisymmetric")


def test_at_rest_the_lowest_eigenvalue_is_one_with_a_pressure_field_too() -> None:
    design = column()
    K, G = bulk_and_shear_modulus(1.0, 0.4999)
    rubber = Design(design.problem.replace(K=K, G=G), design.coefficients)
    assert stability(rubber, [0.0], threads=1).rest == pytest.approx(1, rel=5e-3)
