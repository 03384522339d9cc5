"""Residuals and Newton matrix are the derivatives of C*, Eq. 5, in every field.

The functional (`support.lagrangian`) is put together from the paper's formulas; it shares no
expression with the package.
"""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ng
import numpy as np
import pytest
from support.coupled import FIELDS, Flat
from support.lagrangian import Lagrangian

import ngspring
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import NgspringError
from ngspring.design.design import Design
from ngspring.fem.taylor import taylor_test
from ngspring.problem.material import bulk_and_shear_modulus


@pytest.fixture
def domain() -> str:
    return "quarter"


@pytest.fixture
def nu() -> float | None:
    """Poisson's ratio, if it is not the paper's."""
    return None


@pytest.fixture
def flat(rough: Design, domain: str, nu: float | None) -> Flat:
    if nu is not None:
        K, G = bulk_and_shear_modulus(1.0, nu)
        rough = Design(rough.problem.replace(K=K, G=G), rough.coefficients)
    return Flat(rough, domain)


@pytest.fixture
def functional(flat: Flat) -> Callable[[FloatArray], float]:
    lagrangian = Lagrangian(flat.problem, flat.chi_old, flat.dt)
    return lambda x: lagrangian(flat.state(x))


@pytest.mark.parametrize(
    ("domain", "field", "nu"),
    [
        *(("quarter", name, None) for name in FIELDS),
        ("quarter", "all", None),
        ("full", "all", None),
        *(("quarter", name, 0.499) for name in FIELDS),
        ("full", "all", 0.499),
    ],
)
def test_first_and_second_variation_of_the_lagrangian(
    field: str, flat: Flat, functional: Callable[[FloatArray], float]
) -> None:
    matrix = flat.matrix(flat.x)
    test = taylor_test(
        functional, flat.residual, flat.x, flat.direction(field), lambda x, d: matrix(d)
    )
    assert test.first_order == pytest.approx(2, abs=0.05), str(test)
    if field == "lam":
        # C* is quadratic in lam, by the eliminated q alone: there is no third order, only the
        # tenth digit of NGSolve's symbolic second derivatives of u.
        assert test.second_remainders is not None
        assert (test.second_remainders < 1e-5 * test.first_remainders).all(), str(test)
    else:
        assert test.second_order == pytest.approx(3, abs=0.1), str(test)


@pytest.mark.parametrize("field", FIELDS)
def test_the_taylor_test_sees_an_error_of_a_percent_in_any_field(
    field: str, flat: Flat, functional: Callable[[FloatArray], float]
) -> None:
    matrix = flat.matrix(flat.x)
    d = flat.direction(field)

    def wrong_residual(x: FloatArray) -> FloatArray:
        r = flat.residual(x)
        return r + 0.01 * np.abs(r) * np.sign(d)

    steps = [1e-4 / 2**k for k in range(5)]
    test = taylor_test(functional, wrong_residual, flat.x, d, steps=steps)
    assert test.first_order == pytest.approx(1, abs=0.1), str(test)
    if field != "lam":
        wrong = taylor_test(
            functional, flat.residual, flat.x, d, lambda x, d: 1.1 * matrix(d), steps
        )
        assert wrong.second_order == pytest.approx(2, abs=0.2), str(wrong)


def test_the_transient_term_is_eq_12(flat: Flat) -> None:
    state = flat.state(flat.x)
    system, problem = flat.system, flat.problem
    with_it = system.residual(state, flat.chi_old, flat.dt).chi
    without = system.residual(state, flat.chi_old, np.inf).chi
    scalar = system.scalar
    change, test = ng.GridFunction(scalar.space), ng.GridFunction(scalar.space)
    change.vec.FV().NumPy()[:] = system.extraction_chi @ (state.chi - flat.chi_old)
    direction = np.random.default_rng(1).uniform(-1, 1, system.coefficients)
    test.vec.FV().NumPy()[:] = system.extraction_chi @ direction
    copies = scalar.grid.sector.copies
    measure = 2 * ng.pi * (problem.L / 2 - ng.x) if problem.motion.axis else ng.CF(problem.T)
    density = change * test + problem.l_t**2 * ng.grad(change) * ng.grad(test)
    expected = copies * ng.Integrate(measure * density, scalar.grid.mesh, order=5) / flat.dt
    assert (with_it - without) @ direction == pytest.approx(expected, rel=1e-10)
    assert abs(expected) > 1e-3 * np.linalg.norm(with_it)


def test_every_term_of_eq_8_is_named_and_they_add_up(flat: Flat) -> None:
    residual = flat.system.residual(flat.state(flat.x), flat.chi_old, flat.dt)
    points = {f"control point {j}" for j in range(3)}
    assert set(residual.chi_terms) == {"volume", "interface", "curvature", "transient"} | points
    assert all(norm > 0 for norm in residual.chi_terms.values())
    assert np.linalg.norm(residual.chi) <= sum(residual.chi_terms.values())


def test_the_terms_of_c_are_eqs_9_10_and_11(
    flat: Flat, functional: Callable[[FloatArray], float]
) -> None:
    state = flat.state(flat.x)
    lagrangian = Lagrangian(flat.problem, state.chi, np.inf)
    lagrangian(state)
    terms = flat.system.terms(state)
    q = np.array([terms[f"q{j}"] for j in (1, 2, 3)])
    targets = np.array([point.q for point in flat.problem.control_points])
    weights = np.array([point.weight for point in flat.problem.control_points])
    np.testing.assert_allclose(q, targets + state.lam[:, -1] / weights, rtol=1e-14)
    each = weights / 2 * (q - targets) ** 2
    np.testing.assert_allclose([terms[f"C_q{j}"] for j in (1, 2, 3)], each, rtol=1e-12)
    c_chi = terms["volume"] + terms["interface"] + terms["curvature"]
    assert terms["C"] == pytest.approx(each.sum() + c_chi, rel=1e-13)
    chi = lagrangian.f["chi"]
    rho = 1 / (1 + ng.exp(-chi))
    volume = ng.Integrate(lagrangian.measure * rho, lagrangian.mesh, order=5)
    assert terms["V"] == pytest.approx(volume, rel=1e-12)
    assert terms["volume"] == pytest.approx(flat.problem.k_rho * volume, rel=1e-12)
    expected = ng.Integrate(lagrangian.design, lagrangian.mesh, order=5)
    assert c_chi == pytest.approx(expected, rel=1e-9)


# -- taylor_test itself --------------------------------------------------------------------------


def sine(x: FloatArray) -> float:
    return float(np.sin(x).sum())


X, D = np.array([[0.3, -0.2], [1.1, 2.0]]), np.array([[1.0, 0.5], [-2.0, 0.3]])


def test_orders_of_a_functional_of_ones_own() -> None:
    test = ngspring.taylor_test(sine, np.cos, X, D, lambda x, d: -np.sin(x) * d)
    assert test.first_order == pytest.approx(2, abs=0.05)
    assert test.second_order == pytest.approx(3, abs=0.05)
    assert (np.diff(test.steps) < 0).all()
    assert test.second_remainders is not None
    assert len(test.steps) == len(test.first_remainders) == len(test.second_remainders)
    assert "order" in str(test)


def test_without_a_hessian_only_the_first_order_is_known() -> None:
    test = taylor_test(sine, np.cos, X, D, steps=(0.1, 0.2, 0.1))
    assert test.second_remainders is None
    assert np.isnan(test.second_order)
    assert test.first_order == pytest.approx(2, abs=0.2)
    np.testing.assert_array_equal(test.steps, [0.1, 0.2, 0.1])
    assert "second" not in str(test)


def test_wrong_derivatives_show_the_lower_order() -> None:
    wrong = taylor_test(sine, lambda x: 1.01 * np.cos(x), X, D, lambda x, d: np.sin(x) * d)
    assert wrong.first_order < 1.6
    assert taylor_test(sine, np.cos, X, D, lambda x, d: np.sin(x) * d).second_order < 2.1


def test_an_exact_expansion_has_infinite_order() -> None:
    quadratic = taylor_test(
        lambda x: float((x**2).sum()), lambda x: 2 * x, X, D, lambda x, d: 2 * d
    )
    assert quadratic.first_order == pytest.approx(2, abs=1e-6)
    assert quadratic.second_order == np.inf


def test_a_functional_that_is_not_finite_has_no_order() -> None:
    with np.errstate(invalid="ignore"):
        test = taylor_test(lambda x: float(np.log(x).sum()), lambda x: 1 / x, X, D)
    assert np.isnan(test.first_order)


def test_the_functional_may_change_its_argument() -> None:
    def careless(x: FloatArray) -> float:
        value = sine(x)
        x[:] = 0.0
        return value

    assert taylor_test(careless, np.cos, X, D).first_order == pytest.approx(2, abs=0.05)


@pytest.mark.parametrize("steps", [(0.1,), (0.1, 0.1), (0.1, 0.0), (0.1, -0.2), (0.1, np.nan)])
def test_steps_must_be_two_different_positive_numbers(steps: tuple[float, ...]) -> None:
    with pytest.raises(NgspringError, match="steps"):
        taylor_test(sine, np.cos, X, D, steps=steps)


def test_shapes_must_match() -> None:
    with pytest.raises(NgspringError, match="direction"):
        taylor_test(sine, np.cos, X, D[0])
    with pytest.raises(NgspringError, match="gradient"):
        taylor_test(sine, lambda x: np.cos(x)[0], X, D)
    with pytest.raises(NgspringError, match="hessian"):
        taylor_test(sine, np.cos, X, D, lambda x, d: 1.0)
