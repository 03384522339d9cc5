"""A spring problem is valid, immutable, and the same after a round trip through TOML."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ngspring.basics.errors import ConvergenceError, NgspringError, ProblemError
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import scaled
from ngspring.problem.spring import SpringProblem
from ngspring.problem.toml import FURTHER_KEYS

# A busy machine must not fail a property test.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

POINTS = (ControlPoint(10, 2), ControlPoint(-10, -2), ControlPoint(-20, -4))
POSITIVE = ("L", "H", "T", "K", "G", "l_i", "l_t")
NON_NEGATIVE = ("k_r", "p", "k_rho", "k_i", "k_H")
NAMES = st.text(max_size=200).filter(str.isprintable)
NUMBERS = (*POSITIVE, *NON_NEGATIVE, "E_0", "n")


def finite(low: float | None = None, **bounds: Any) -> st.SearchStrategy[float]:
    return st.floats(low, allow_nan=False, allow_infinity=False, **bounds)


@st.composite
def problems(draw: st.DrawFn) -> SpringProblem:
    values: dict[str, Any] = {name: draw(st.floats(0.1, 100.0)) for name in POSITIVE}
    values |= {name: draw(st.just(0.0) | st.floats(1e-12, 1e9)) for name in NON_NEGATIVE}
    H, offsets = values["H"], st.floats(1e-9, 1e9) | st.floats(-1e9, -1e-9) | st.just(0.0)
    shares = st.floats(1e-5, 1.0, exclude_max=True) | st.floats(-1.0, -1e-5, exclude_min=True)
    forces = st.floats(-1e3, 1e3).map(lambda q: round(q, 3))
    aims = st.none() | forces
    points = st.builds(
        ControlPoint,
        shares.map(lambda share: share * H),
        forces,
        st.floats(1e-9, 1e9),
        offsets,
        aims,
    )
    return SpringProblem(
        tuple(draw(st.lists(points, min_size=1, max_size=5, unique_by=lambda c: (c.d, c.eta)))),
        name=draw(NAMES),
        kinematics=draw(st.sampled_from(["plane strain", "axisymmetric"])),
        domain=draw(st.sampled_from(["quarter", "full"])),
        elements=2 * draw(st.integers(2, 1000)),
        E_0=draw(st.floats(1e-15, 1.0, exclude_max=True)),
        n=draw(st.floats(2.0, 20.0)),
        **values,
    )


def message_of(make: Any, *args: Any, **kwargs: Any) -> str:
    """Return the message of the ProblemError that the call raises; it is one line."""
    with pytest.raises(ProblemError) as caught:
        make(*args, **kwargs)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def refused(field: str, value: Any) -> str:
    message = message_of(SpringProblem, **{"control_points": POINTS, field: value})
    assert message.startswith(f"{field} = {value!r} ")
    return message


# Table 1


def test_defaults_are_those_of_table_1() -> None:
    problem = SpringProblem(POINTS)
    assert (problem.L, problem.H, problem.T, problem.elements) == (100, 100, 1, 80)
    assert (problem.K, problem.G) == (5 / 3, 5 / 14)
    assert (problem.E_0, problem.k_r, problem.p) == (1e-6, 1e-6, 8)
    assert (problem.k_rho, problem.k_H) == (1e-8, 1e-9)
    assert (problem.k_i, problem.n, problem.l_i, problem.l_t) == (1e-2, 6, 1, 8)
    assert (problem.kinematics, problem.domain, problem.name) == ("plane strain", "quarter", "")
    assert ControlPoint(10, 2) == ControlPoint(d=10.0, q=2.0, weight=1.0, eta=0.0)


# Description


def test_problem_and_control_point_are_immutable() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        SpringProblem(POINTS).H = 50.0  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        POINTS[0].d = 5.0  # type: ignore[misc]


def test_integers_become_floats_and_lists_become_tuples() -> None:
    problem = SpringProblem(list(POINTS), L=50, n=4)  # type: ignore[arg-type]
    assert problem.control_points == POINTS
    assert isinstance(problem.L, float)
    assert isinstance(problem.n, float)
    assert isinstance(ControlPoint(10, 2).d, float)
    assert hash(problem) == hash(SpringProblem(POINTS, L=50.0, n=4.0))


def test_element_sizes_and_flags() -> None:
    problem = SpringProblem(POINTS, L=60, H=120, elements=40)
    assert (problem.h_x, problem.h_y) == (1.5, 3.0)
    assert problem.sector.half_height
    assert not problem.motion.axis
    assert not problem.replace(domain="full").sector.half_height
    assert problem.replace(kinematics="axisymmetric").motion.axis


@pytest.mark.parametrize("domain", ["quarter", "full"])
def test_chi_has_one_ghost_coefficient_in_x_and_none_in_y(domain: str) -> None:
    n_x, n_y = SpringProblem(POINTS, domain=domain).coefficient_shape
    assert (n_x, n_y) == (41, 40)
    assert n_x * n_y == 1640


def test_replace_changes_only_what_it_is_told() -> None:
    problem = SpringProblem(POINTS, name="spring")
    finer = problem.replace(elements=160, l_i=0.5)
    assert (finer.elements, finer.l_i, finer.name) == (160, 0.5, "spring")
    assert finer.replace(elements=80, l_i=1.0) == problem
    assert message_of(problem.replace, elements=81).startswith("elements = 81 ")
    assert "'element': did you mean 'elements'?" in message_of(problem.replace, element=40)


def test_input_errors_are_value_errors_and_failed_analyses_are_not() -> None:
    assert issubclass(ProblemError, NgspringError)
    assert issubclass(NgspringError, ValueError)
    assert issubclass(ConvergenceError, RuntimeError)
    assert not issubclass(ConvergenceError, ValueError)


# Bad values


@pytest.mark.parametrize("field", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1", None, [1.0], 1j])
def test_what_is_not_a_finite_number_is_refused(field: str, value: Any) -> None:
    assert "number" in refused(field, value)


@pytest.mark.parametrize("field", ["d", "q", "weight", "eta"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, False, "1", None])
def test_what_is_not_a_finite_number_is_refused_in_a_control_point(field: str, value: Any) -> None:
    message = message_of(ControlPoint, **{"d": 10, "q": 2, field: value})
    assert message.startswith(f"{field} = {value!r} ")


def test_an_integer_too_large_for_a_float_is_refused_however_long_it_is() -> None:
    assert "finite" in message_of(SpringProblem, POINTS, L=10**400)
    assert len(message_of(SpringProblem, POINTS, L=10**5000)) < 200


@pytest.mark.parametrize("field", POSITIVE)
@given(value=finite(max_value=0.0))
def test_zero_and_negative_sizes_and_moduli_are_refused(field: str, value: float) -> None:
    assert "positive" in refused(field, value)


@pytest.mark.parametrize("field", NON_NEGATIVE)
@given(value=finite(max_value=0.0, exclude_max=True).filter(bool))
def test_negative_weights_are_refused(field: str, value: float) -> None:
    assert "zero or positive" in refused(field, value)


@pytest.mark.parametrize("field", NON_NEGATIVE)
def test_zero_weights_are_allowed(field: str) -> None:
    assert getattr(SpringProblem(POINTS).replace(**{field: 0}), field) == 0.0


@given(value=finite(max_value=0.0) | finite(1.0))
def test_stiffness_of_void_is_strictly_between_0_and_1(value: float) -> None:
    assert "between 0 and 1" in refused("E_0", value)


@given(value=finite(max_value=2.0, exclude_max=True))
def test_exponent_below_2_is_refused(value: float) -> None:
    assert "at least 2" in refused("n", value)


@pytest.mark.parametrize("domain", ["quarter", "full"])
@given(value=st.integers(max_value=3) | st.integers().map(lambda k: 2 * k + 1))
def test_odd_or_few_elements_are_refused(domain: str, value: int) -> None:
    message = message_of(SpringProblem, POINTS, domain=domain, elements=value)
    assert message.startswith(f"elements = {value} ")
    assert "even" in message


@pytest.mark.parametrize("value", [80.0, True, "80", None, math.nan])
def test_number_of_elements_is_an_integer(value: Any) -> None:
    assert "integer" in refused("elements", value)


@pytest.mark.parametrize(
    ("field", "value", "nearest"),
    [
        ("kinematics", "axisymetric", "axisymmetric"),
        ("kinematics", "Plane Strain", "plane strain"),
        ("kinematics", "plane stress", "plane strain"),
        ("domain", "Quater", "quarter"),
        ("domain", "ful", "full"),
    ],
)
def test_unknown_choice_names_the_nearest_valid_one(field: str, value: str, nearest: str) -> None:
    assert f"did you mean {nearest!r}?" in refused(field, value)


@pytest.mark.parametrize("field", ["kinematics", "domain", "name"])
@pytest.mark.parametrize("value", [None, 1, ["full"]])
def test_text_fields_take_only_strings(field: str, value: Any) -> None:
    refused(field, value)


@given(value=st.text().filter(lambda text: text not in KINEMATICS))
def test_any_other_text_is_no_kinematics(value: str) -> None:
    message = message_of(SpringProblem, POINTS, kinematics=value)
    assert message.startswith("kinematics = ")


@pytest.mark.parametrize("name", ["\ud800", "a\nb", "\x1b[31mred", "\u202egnp.exe", 3, None])
def test_a_name_that_cannot_be_shown_is_refused(name: Any) -> None:
    assert "printable" in refused("name", name)


def test_a_name_is_of_bounded_length() -> None:
    assert SpringProblem(POINTS, name="x" * 200).name
    message = message_of(SpringProblem, POINTS, name="x" * 201)
    assert "at most 200 characters" in message
    assert len(message) < 300


# Numbers that double precision cannot compute with


@pytest.mark.parametrize("value", [1e200, 1e-300, 5e-324, 1e30, 1e-30])
@pytest.mark.parametrize("field", POSITIVE)
def test_a_size_or_stiffness_that_overflows_is_refused(field: str, value: float) -> None:
    assert "double precision" in refused(field, value)


@pytest.mark.parametrize("value", [1e200, -1e200, 1e-300, 5e-324, 1e30, -1e-30])
@pytest.mark.parametrize("field", ["d", "q", "weight", "eta"])
def test_a_control_point_far_from_the_spring_is_refused(field: str, value: float) -> None:
    values = {"d": 10.0, "q": 2.0, field: abs(value) if field in ("d", "weight") else value}
    if value not in (1e30, -1e-30) or field != "weight":
        message = message_of(SpringProblem, [ControlPoint(**values)])
        assert message.startswith(f"control_points[0].{field} = ")


@pytest.mark.parametrize("name", ["k_rho", "k_i", "k_H"])
def test_weights_that_overflow_are_refused_and_those_that_vanish_are_not(name: str) -> None:
    assert "double precision" in refused(name, 1e200)
    assert getattr(SpringProblem(POINTS, **{name: 1e-300}), name) == 1e-300


@pytest.mark.parametrize("length", [1e-5, 1.0, 1e4])
@pytest.mark.parametrize("stress", [1e-6, 1.0, 1e6])
def test_every_spring_from_micrometres_and_pascals_to_kilometres_and_terapascals_is_accepted(
    length: float, stress: float
) -> None:
    for similar in (SpringProblem(POINTS), SpringProblem(POINTS, kinematics="axisymmetric")):
        scaled(similar, length=length, stress=stress)
    # Also without any thought for the other numbers.
    points = [ControlPoint(10 * length, 2.0 * stress * length**2)]
    SpringProblem(
        points, L=100 * length, H=100 * length, T=length, K=2 * stress, G=stress, l_i=length
    )


def test_elements_and_control_points_are_bounded() -> None:
    for elements in (2002, 10**9, 10**400):
        assert "at most 2000" in message_of(SpringProblem, POINTS, elements=elements)
    points = [ControlPoint(0.01 * k, 1.0) for k in range(1, 1002)]
    assert "at most 1000" in message_of(SpringProblem, points)
    assert len(SpringProblem(points[:1000]).control_points) == 1000


# Bad control points


@pytest.mark.parametrize("value", [(), [], None, 3, POINTS[0]])
def test_at_least_one_control_point_is_needed(value: Any) -> None:
    assert message_of(SpringProblem, value).startswith("control_points = ")


@pytest.mark.parametrize("value", [(10, 2), None, "C1"])
def test_control_points_of_another_type_are_refused(value: Any) -> None:
    message = message_of(SpringProblem, (POINTS[0], value))
    assert message.startswith(f"control_points[1] = {value!r} ")


@pytest.mark.parametrize("value", [0, 0.0, -0.0])
def test_zero_displacement_is_refused(value: float) -> None:
    assert message_of(ControlPoint, value, 2.0).startswith(f"d = {float(value)!r} ")


@given(value=finite(max_value=0.0))
def test_weight_of_a_control_point_is_positive(value: float) -> None:
    assert message_of(ControlPoint, 10, 2, weight=value).startswith(f"weight = {value!r} ")


@given(d=finite(30.0), sign=st.sampled_from([-1.0, 1.0]))
def test_displacement_of_the_height_or_more_is_refused(d: float, sign: float) -> None:
    message = message_of(SpringProblem, [ControlPoint(sign * d, 1)], H=30)
    assert message.startswith(f"control_points[0].d = {sign * d!r} ")
    assert "H = 30.0" in message


def test_contradictory_control_points_are_refused() -> None:
    message = message_of(SpringProblem, (*POINTS, ControlPoint(-20, -5)))
    assert "control_points[2] and [3]" in message
    assert "d = -20.0" in message
    assert "q = -4.0 and -5.0" in message


def test_a_control_point_given_twice_is_refused_whatever_its_weight() -> None:
    message = message_of(SpringProblem, (*POINTS, ControlPoint(-20, -4, weight=2)))
    assert "control_points[2] and [3]" in message
    assert "given once" in message


def test_what_the_third_medium_is_asked_for_is_the_target_unless_it_is_corrected() -> None:
    assert ControlPoint(10, 2).q_star == 2.0
    assert ControlPoint(10, 2, aim=1.9).q_star == 1.9
    corrected = SpringProblem([ControlPoint(10, 2, aim=1.9)])
    similar = scaled(corrected, length=2.0, stress=3.0, thickness=1.0)
    assert similar.control_points[0].q_star == pytest.approx(1.9 * 6.0)
    assert "aim = nan" in message_of(ControlPoint, 10, 2, aim=float("nan"))
    assert "q_star" in message_of(SpringProblem, [ControlPoint(10, 2, aim=1e30)])


def test_the_same_displacement_of_a_dilated_design_is_no_contradiction() -> None:
    SpringProblem((*POINTS, ControlPoint(-20, -4, eta=2), ControlPoint(-20, -5, eta=1e3)))


# TOML


@given(problem=problems())
def test_toml_round_trip_is_exact(problem: SpringProblem) -> None:
    assert SpringProblem.from_toml(problem.to_toml()) == problem


def test_toml_has_one_table_per_control_point() -> None:
    assert SpringProblem(POINTS).to_toml().count("\n[[control_points]]\n") == 3


def test_toml_needs_only_the_control_points() -> None:
    text = "[[control_points]]\nd = 10\nq = 2\n[[control_points]]\nd = -10.0\nq = -2\neta = 2"
    points = ControlPoint(10, 2), ControlPoint(-10, -2, eta=2)
    assert SpringProblem.from_toml(text) == SpringProblem(points)


@pytest.mark.parametrize("as_given", [Path, str])
@pytest.mark.parametrize("file_name", ["spring.toml", "spring"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_toml_file_is_read(tmp_path: Path, as_given: Any, file_name: str, mark: str) -> None:
    problem = SpringProblem(POINTS, name="Fjäder χ")
    path = tmp_path / file_name
    path.write_bytes((mark + problem.to_toml().replace("\n", "\r\n")).encode())
    assert SpringProblem.from_toml(as_given(path)) == problem


def test_toml_text_may_end_with_the_name_of_a_file() -> None:
    problem = SpringProblem(POINTS)
    assert SpringProblem.from_toml(problem.to_toml() + "# from spring.toml") == problem


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["missing key 'control_points'"]),
        ("l_I = 2", ["unknown key 'l_I'", "did you mean 'l_i'?"]),
        ("E0 = 1e-3", ["unknown key 'E0'", "did you mean 'E_0'?"]),
        ("[[control_point]]\nd = 1", ["'control_point'", "did you mean 'control_points'?"]),
        ("control_points = 3", ["control_points = 3", "[[control_points]]"]),
        ("control_points = []", ["control_points = ()", "at least one"]),
        ("control_points = [[10, 2]]", ["control_points[0] = [10, 2]", "table"]),
        ("control_points = [{d = 1, q = 1}, {q = 2}]", ["missing key 'd' in control_points[1]"]),
        ("control_points = [{d = 1}]", ["missing key 'q' in control_points[0]"]),
        ("control_points = [{d = 1, q = 2, wight = 1}]", ["'wight'", "did you mean 'weight'?"]),
        ("control_points = [{d = 0, q = 2}]", ["control_points[0].d = 0.0"]),
        ("control_points = [{d = 1, q = nan}]", ["control_points[0].q = nan"]),
        ("elements = 81\ncontrol_points = [{d = 1, q = 2}]", ["elements = 81", "even"]),
        ("L = 1979-05-27\ncontrol_points = [{d = 1, q = 2}]", ["L = datetime.date(1979, 5, 27)"]),
        ("L = \nH = 1", ["not valid TOML", "line 1"]),
        ("L = 1\nL = 2", ["not valid TOML", "overwrite"]),
        ("spring", ["not valid TOML"]),
        pytest.param("L = " + 5000 * "1", ["not valid"], id="too many digits"),
        pytest.param("L = " + 9000 * "[", ["not valid TOML"], id="nested too deeply"),
    ],
)
def test_bad_toml_is_refused_with_its_reason(text: str, parts: list[str], tmp_path: Path) -> None:
    message = message_of(SpringProblem.from_toml, text)
    assert all(part in message for part in parts)
    path = tmp_path / "spring.toml"
    path.write_text(text)
    assert message_of(SpringProblem.from_toml, path) == f"{str(path)!r}: {message}"


#: Fields, and E, nu and so on, which are read in their place.
KNOWN_KEYS = {*SpringProblem.__dataclass_fields__, *FURTHER_KEYS}


@given(key=st.text().filter(lambda key: key not in KNOWN_KEYS))
def test_any_other_key_is_refused(key: str) -> None:
    escaped = re.sub(r".", lambda m: f"\\U{ord(m[0]):08X}", key, flags=re.DOTALL)
    message = message_of(SpringProblem.from_toml, f'"{escaped}" = 1')
    assert message.startswith("unknown key ")


@given(text=st.text())
def test_arbitrary_text_never_escapes_as_another_error(text: str) -> None:
    message_of(SpringProblem.from_toml, text)


@pytest.mark.parametrize("name", ["missing.toml", "nul\0.toml", "two\nlines.toml"])
def test_missing_file_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    assert message_of(SpringProblem.from_toml, path).startswith(repr(str(path)))


def test_text_that_looks_like_a_file_is_read_as_one() -> None:
    assert "cannot be read" in message_of(SpringProblem.from_toml, "nowhere/missing.toml")


def test_folder_is_no_file(tmp_path: Path) -> None:
    assert "cannot be read" in message_of(SpringProblem.from_toml, tmp_path)


def test_file_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('name = "Fjäder"'.encode("latin-1"))
    message = message_of(SpringProblem.from_toml, path)
    assert "not UTF-8" in message
    assert "byte 10" in message


@pytest.mark.parametrize("value", [None, 3, b"L = 1"])
def test_toml_is_text_or_a_path(value: Any) -> None:
    assert repr(value) in message_of(SpringProblem.from_toml, value)
