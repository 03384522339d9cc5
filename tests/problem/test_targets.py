"""From a file of numbers to a spring problem: CSV, control points, TOML keys, the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.commands import invoke

from ngspring.basics.errors import ProblemError
from ngspring.problem.annotated import annotated_toml
from ngspring.problem.cases import cases
from ngspring.problem.curves.curve import TargetCurve, parse_curve, read_curve
from ngspring.problem.material import bulk_and_shear_modulus, young_from_shore_A
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import scaled, with_similar_weights
from ngspring.problem.spring import SpringProblem

SPRING = SpringProblem((ControlPoint(10, 2),))


def size_of(problem: SpringProblem) -> tuple[float, float]:
    return problem.H, problem.top_area


PAIRS = [(-20.0, -4.5), (-10.0, -2.0), (10.0, 2.25)]


def pairs_of(text: str, problem: SpringProblem = SPRING) -> list[tuple[float, float]]:
    curve = parse_curve(text, *size_of(problem))
    return list(zip(curve.d.tolist(), curve.q.tolist(), strict=True))


def refused(text: str, problem: SpringProblem = SPRING) -> str:
    with pytest.raises(ProblemError) as error:
        parse_curve(text, *size_of(problem))
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) <= 300
    return str(error.value)


# -- one table in many hands -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "d,q\n-20,-4.5\n-10,-2\n10,2.25\n",
        "-20,-4.5\n-10,-2\n10,2.25",
        "10 2.25\n-10   -2\n-20\t-4.5",
        "d [mm], q [N]\n-20.0, -4.5\n-10.0, -2.0\n10.0, 2.25",
        "d [mm];q [N]\r\n-20;-4,5\r\n-10;-2,0\r\n10;2,25\r\n",
        "-20,0\t-4,5\n-10,0\t-2,0\n10,0\t2,25",
        "-20,0 -4,5\n-10,0 -2,0\n10,0 2,25",
        "# measured on Monday\nd q\n\n-20 -4.5\n  # a pause\n-10 -2\n10 2.25",
        "d (m),q (kN)\n-0.02,-0.0045\n-0.01,-2e-3\n0.01,2.25e-3",
        "Force [mN];Displacement [cm]\n-4500;-2\n-2000;-1\n2250;1",
        '"d [mm]","q [N]"\n-20,-4.5\n-10,-2\n10,2.25',
        "d [mm] q [N]\n-20 -4.5\n-10 -2\n10 2.25",
        "d,q,energy,stiffness\n-20,-4.5,1,1\n-10,-2,1,1\n0,0,0,1\n10,2.25,1,1",
        "time [s],load [N],travel [mm]\n2,-4.5,-20\n1,-2,-10\n0,2.25,10",
        "strain,stress\n-0.2,-0.045\n-0.1,-0.02\n0.1,0.0225",
        "strain [%];stress [kPa]\n-20;-45\n-10;-20\n10;22,5",
        "ε [-]\tσ [Pa]\n-0.2\t-45e3\n-0.1\t-20e3\n0.1\t22.5e3",
        "Weg [mm];Kraft [N]\n-20;-4,5\n-10;-2\n10;2,25",
        "d,width [mm],Kraft [N]\n-20,3,-4.5\n-10,3,-2\n10,3,2.25",
        "d [mm],q [N],\n-20,-4.5,\n-10,-2,\n10,2.25,",
        "d / mm;q / N\n-20;-4,5\n-10;-2\n10;2,25",
        "d/mm,F/kN\n-20,-0.0045\n-10,-0.002\n10,0.00225",
        "d / mm q / N\n-20 -4.5\n-10 -2\n10 2.25",
        "ε / %;σ / (N/mm²)\n-20;-0,045\n-10;-0,02\n10;0,0225",
        "Weg / cm;Kraft / N\n-2;-4,5\n-1;-2\n1;2,25",
        "d_mm,F_N\n-20,-4.5\n-10,-2\n10,2.25",
        "time_s,Force_mN,Displacement_cm\n0,-4500,-2\n1,-2000,-1\n2,2250,1",
        "strain_%,stress_MPa\n-20,-0.045\n-10,-0.02\n10,0.0225",
        "Weg_mm;Kraft_N\n-20;-4,5\n-10;-2\n10;2,25",
        # Neither a ratio nor a stiffness is a displacement.
        "d/H,stiffness N/mm,Weg [mm],q\n-0.2,1,-20,-4.5\n-0.1,1,-10,-2\n0.1,1,10,2.25",
        "N/mm,d_1,d,q\n1,7,-20,-4.5\n1,7,-10,-2\n1,7,10,2.25",
    ],
)
def test_the_same_curve_however_it_is_written(text: str) -> None:
    found = [pair for pair in pairs_of(text) if pair[0] != 0.0]
    assert np.array(found) == pytest.approx(np.array(PAIRS), rel=1e-12)


def test_stress_and_strain_are_those_of_the_spring_s_size() -> None:
    text = "strain,stress [MPa]\n0.1,0.02"
    flat = SPRING.replace(L=30.0, H=50.0, T=4.0)
    assert pairs_of(text, flat) == [pytest.approx((5.0, 0.02 * 120.0))]
    round_ = flat.replace(kinematics="axisymmetric")
    assert pairs_of(text, round_) == [pytest.approx((5.0, 0.02 * np.pi / 4 * 900.0))]


def numbers(largest: float) -> st.SearchStrategy[float]:
    """What is closer to zero than any calculation notices is read as zero."""
    return st.floats(-largest, largest).filter(lambda value: value == 0.0 or abs(value) > 1e-99)


@given(
    pairs=st.lists(
        # What is 1e-12 of the height or of the largest force, or less, is rounding.
        st.tuples(
            st.floats(-90, 90).filter(lambda d: not d or abs(d) > 1e-9),
            st.floats(-1e6, 1e6).filter(lambda q: not q or abs(q) > 1e-5),
        ),
        min_size=1,
        max_size=40,
        unique_by=lambda pair: pair[0],
    ).filter(lambda pairs: any(d for d, _ in pairs)),
    separator=st.sampled_from([",", ";", "\t", " "]),
    comma=st.booleans(),
    falling=st.booleans(),
)
def test_numbers_come_back_exactly(
    pairs: list[tuple[float, float]], separator: str, comma: bool, falling: bool
) -> None:
    pairs.sort(reverse=falling)
    rows = [separator.join(f"{value!r}" for value in pair) for pair in pairs]
    # Some number must have a decimal comma that cannot be mistaken.
    if comma and separator == ";":
        rows.insert(0 if falling else len(rows), "95.25;1.5")
        rows = [row.replace(".", ",") for row in rows]
        pairs = [*pairs, (95.25, 1.5)]
    assert pairs_of("\n".join(rows)) == sorted((d + 0.0, q) for d, q in pairs)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["no rows"]),
        ("# nothing\n\n", ["no rows"]),
        ("d,q\n", ["no rows of numbers", "save it as CSV with a header such as d [mm];q [N]"]),
        ("d,q\n0,0\n", ["no point with d different from zero"]),
        ("1\n2\n", ["not a row of two numbers"]),
        ("10,0,2,0\n20,0,4,5\n", ["4 columns", "semicolons"]),
        ("d,q\n10,0,2,0\n", ["header has 2 columns", "rows have 4"]),
        ("1,2\n3\n", ["not a row of two numbers"]),
        ("1;2\n3;4;5\n", ["line 2 has 3 columns"]),
        ("d,q\n10,2\n20,four\n", ["line 3", "not numbers"]),
        ("d,q\n10,2\nMaximum: 2 N\n", ["line 3", "leave it out"]),
        ("10,2\n20,four\n30,5\n", ["line 2", "not numbers"]),
        ("d,q,e\n10,2,3\n20,,\n", ["line 3", "columns 1 and 2"]),
        ("d,q\n1,1e308\n-1,-1e308", ["line 2", "too large"]),
        ("10,2\n20,nan\n", ["line 2", "not finite"]),
        ("10;2\n20;inf\n", ["line 2", "not finite"]),
        ("1,000;2\n", ["decimal comma or a thousands separator"]),
        ("1.234,5;2\n", ["mixed"]),
        ("1,234,567;2\n", ["two commas"]),
        ("d [feet],q\n10,2\n", ["unit 'feet'", "mm, cm, m"]),
        ("d,q [g]\n10,2\n", ["unit 'g'", "N, kN"]),
        ("d,stress\n10,2\n", ["column for d but none for q"]),
        ("d,d\n10,2\n", ["column for d but none for q"]),
        ("d [mm],extension [mm],q\n10,10,2\n", ["two columns are named like 'd'"]),
        ("length,time\n10,2\n", ["line 1: none of its 2 columns is named d"]),
        ("length,time\n10,2\n", ["write for example d [mm];q [N]"]),
        ("length,q\n10,2\n", ["none for d", "write for example d [mm];q [N]"]),
        ("Weg [mm],Weite [mm],Kraft [N]\n10,2,3\n", ["column for q but none for d"]),
        ("d,q\n120,2\n", ["d = 120 mm", "H = 100 mm"]),
        ("d,q\n20000,2\n", ["in µm?"]),
        ("strain,stress\n20,0.1\n", ["strain [%]"]),
        ("stretch [%],stress\n110,0.1\n", ["unit '%' of column 'stretch [%]'"]),
        ("stretch,stress\n0,0.1\n", ["a stretch above 0"]),
        ("Green strain [-],PK2 [MPa]\n0.1,0.1\n", ["'Green strain [-]' is neither nominal nor"]),
        ("\x00\x01", ["save it as CSV"]),
        (f"{'x' * 200_000},q\n1,2", ["is not CSV"]),
    ],
)
def test_what_would_need_guessing_is_refused(text: str, parts: list[str]) -> None:
    message = refused(text)
    assert all(part in message for part in parts), message


@given(text=st.text(alphabet="0123456789.,;-+e dq[]mN#%\n\t"))
def test_arbitrary_tables_never_escape_as_another_error(text: str) -> None:
    try:
        curve = parse_curve(text, *size_of(SPRING))
    except ProblemError:
        return
    assert (np.diff(curve.d) > 0).all()


def test_a_displacement_a_little_too_large_is_no_mistaken_unit() -> None:
    assert refused("d,q\n100,2\n").endswith("the spring is only H = 100 mm high")


def test_assumptions_are_told() -> None:
    assert "no header" in parse_curve("10,2", *size_of(SPRING)).remarks[0]
    assert "no unit: taken as [N]" in parse_curve("d [mm],q\n10,2", *size_of(SPRING)).remarks[0]
    assert parse_curve("d [mm],q [N]\n10,2\n-10,-2", *size_of(SPRING)).remarks == ()


# -- tests in compression --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "header",
    [
        "compression [mm],force [N]",
        "compression,force",
        "compression / mm,F / N",
        "compression_mm,compressive_force_N",
        "d [mm],compressive load [N]",
        "Crush distance [mm],Force [N]",
        "Stauchung [mm],Kraft [N]",
        "Weg [mm],Druckkraft [N]",
    ],
)
def test_a_column_named_compression_counts_it_as_positive(header: str) -> None:
    curve = parse_curve(f"{header}\n5,1\n10,2.5\n-3,-0.5\n", *size_of(SPRING))
    assert curve.d.tolist() == [-10.0, -5.0, 3.0]
    assert curve.q.tolist() == [-2.5, -1.0, 0.5]
    assert "both signs are turned" in curve.remarks[-1]


def test_compressive_strain_and_stress_are_turned_too() -> None:
    curve = parse_curve("compressive strain [%],compressive stress [kPa]\n5,20", *size_of(SPRING))
    assert (curve.d.tolist(), curve.q.tolist()) == ([-5.0], [pytest.approx(-2.0)])


def test_negative_numbers_in_a_column_named_compression_are_compression() -> None:
    curve = parse_curve("compression [mm],force [N]\n-5,-1\n-10,-2\n", *size_of(SPRING))
    assert curve.d.tolist() == [-10.0, -5.0]
    assert "stay as they are" in curve.remarks[-1]


def test_compression_can_be_said_whatever_the_names_are() -> None:
    for header in ("d [mm],q [N]\n", "compression [mm],force [N]\n"):
        curve = parse_curve(f"{header}0,0\n5,1\n10,2.5\n", *size_of(SPRING), compression=True)
        assert curve.d.tolist() == [-10.0, -5.0, 0.0]
        assert curve.q.tolist() == [-2.5, -1.0, 0.0]
    with pytest.raises(ProblemError, match="compression already: leave it out"):
        parse_curve("d [mm],q [N]\n-5,-1\n-10,-2\n", *size_of(SPRING), compression=True)


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("d [mm],q [N]\n0,0\n5,1\n10,2", True),
        ("5,1\n10,2", True),
        ("d [mm],q [N]\n-0.01,-0.001\n5,1\n10,2", True),
        ("extension [mm],force [N]\n5,1\n10,2", False),
        ("d [mm],q [N]\n5,1\n-10,-2", False),
        ("d [mm],q [N]\n-5,-1\n-10,-2", False),
    ],
)
def test_positive_numbers_alone_may_be_a_compression_test(text: str, asked: bool) -> None:
    assert (
        any("give --compression" in r for r in parse_curve(text, *size_of(SPRING)).remarks) == asked
    )


def test_files_are_read_with_a_byte_order_mark_and_named_in_errors(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_bytes("\ufeffd [mm];q [N]\r\n10;2,5\r\n".encode())
    assert read_curve(path, *size_of(SPRING)).q.tolist() == [2.5]
    for encoding in ("latin-1", "utf-16", "utf-16-be"):
        mark = "\ufeff" if encoding == "utf-16-be" else ""
        path.write_bytes(f"{mark}d [µm];q\n1000;2,5".encode(encoding))
        curve = read_curve(path, *size_of(SPRING))
        assert (curve.d.tolist(), curve.q.tolist()) == ([1.0], [2.5])
    path.write_bytes(b"PK\x03\x04\x00\x00")
    with pytest.raises(ProblemError, match=r"curve\.csv'.*not text .*save it as CSV"):
        read_curve(path, *size_of(SPRING))
    with pytest.raises(ProblemError, match="cannot be read"):
        read_curve(tmp_path / "missing.csv", *size_of(SPRING))


# -- from many points to a few ---------------------------------------------------------------------


def dense(f: Any, low: float = -20.0, high: float = 10.0, count: int = 400) -> TargetCurve:
    d = np.linspace(low, high, count)
    return parse_curve(
        "\n".join(f"{a},{b}" for a, b in zip(d, f(d), strict=True)), *size_of(SPRING)
    )


def test_a_few_points_are_taken_as_they_are() -> None:
    points = TargetCurve(*np.array(PAIRS).T).control_points()
    assert [(p.d, p.q) for p in points] == PAIRS


def test_a_straight_line_needs_its_ends_and_middles() -> None:
    points = dense(lambda d: 0.2 * d).control_points()
    assert [p.d for p in points] == [-20.0, -10.0, 5.0, 10.0]
    assert [p.q for p in points] == pytest.approx([-4.0, -2.0, 1.0, 2.0], rel=1e-4)


def test_a_kink_gets_more_points() -> None:
    def kinked(d: Any) -> Any:
        return 0.2 * d + np.minimum(d + 14.0, 0.0)

    curve = dense(kinked)
    points = curve.control_points()
    assert 4 < len(points) <= 6
    assert any(-16 < p.d < -13 for p in points)
    ends_and_middles = curve.control_points(at=[-20, -10, 5, 10])
    assert curve.deviation(points) < 0.4 * curve.deviation(ends_and_middles)


def test_the_chosen_points_lie_on_the_curve() -> None:
    curve = dense(lambda d: 0.2 * d - 0.003 * d**2)
    for p in curve.control_points(5):
        assert p.q == pytest.approx(0.2 * p.d - 0.003 * p.d**2, abs=2e-3)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_as_many_points_as_asked_for(count: int) -> None:
    points = dense(lambda d: 0.2 * d - 0.003 * d**2).control_points(count)
    assert len(points) == len({p.d for p in points}) == count
    assert points[0].d == -20.0


def test_points_at_given_displacements() -> None:
    curve = TargetCurve(*np.array(PAIRS).T)
    points = curve.control_points(at=[10, -15.0], weight=0.5)
    assert [p.d for p in points] == [10.0, -15.0]
    assert -4.5 < points[1].q < -2.0
    assert (points[0].q, points[0].weight) == (2.25, 0.5)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ({"at": [30.0]}, "d = 30 mm lies outside the curve, which goes from -20 to 10"),
        ({"at": [0.0]}, "d = 0.0"),
        ({"at": ["ten"]}, "at = 'ten'"),
        ({"points": 4}, "3 points, fewer than 4"),
        ({"points": 0}, "at least 1"),
        ({"points": 2, "at": [10.0]}, "either"),
    ],
)
def test_points_that_the_curve_does_not_have(arguments: dict[str, Any], part: str) -> None:
    with pytest.raises(ProblemError, match=part):
        TargetCurve(*np.array(PAIRS).T).control_points(**arguments)


def test_noise_in_the_displacement_does_no_harm(random: np.random.Generator) -> None:
    d = np.linspace(-20, 20, 2000) + random.normal(0, 0.05, 2000)
    curve = parse_curve("\n".join(f"{a},{0.2 * a}" for a in d), *size_of(SPRING))
    assert curve.remarks == (
        "no header: the first column is taken as d in mm, the second as q in N",
    )
    assert curve.force(12.3) == pytest.approx(2.46, rel=1e-3)


def test_a_curve_that_misses_the_origin_is_told() -> None:
    assert "does not pass through the origin" in dense(lambda d: 0.2 * d + 1).remarks[-1]
    assert len(dense(lambda d: 0.2 * d).remarks) == 1


# -- TOML ------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = "\n".join(f"{d!r};{q!r}" for d, q in PAIRS)
    (tmp_path / "curve.csv").write_text(f"d [mm];q [N]\n{rows}\n")
    return tmp_path


def problem_of(folder: Path, text: str) -> SpringProblem:
    (folder / "spring.toml").write_text(text)
    return SpringProblem.from_toml(folder / "spring.toml")


def test_targets_of_a_problem_are_beside_its_file(folder: Path) -> None:
    problem = problem_of(folder, 'targets = "curve.csv"\nw_q = 0.5\nshore_A = 40\nnu = 0.45')
    assert [(p.d, p.q, p.weight) for p in problem.control_points] == [(*p, 0.5) for p in PAIRS]
    expected = bulk_and_shear_modulus(young_from_shore_A(40), 0.45)
    assert expected == (problem.K, problem.G)
    again = SpringProblem.from_toml(problem.to_toml())
    assert again == problem


def test_targets_in_stress_and_strain_use_the_size_in_the_file(folder: Path) -> None:
    (folder / "curve.csv").write_text("strain,stress\n0.1,0.02\n-0.1,-0.02\n-0.2,-0.05")
    problem = problem_of(
        folder, 'targets = {file = "curve.csv", at = [2, -4]}\nH = 20\nT = 3\nL = 10'
    )
    assert [p.d for p in problem.control_points] == [2.0, -4.0]
    assert [p.q for p in problem.control_points] == pytest.approx([0.6, -1.5])


def test_a_problem_can_say_that_its_targets_count_compression_as_positive(folder: Path) -> None:
    (folder / "curve.csv").write_text("d [mm],q [N]\n5,1\n10,2.5")
    problem = problem_of(folder, 'targets = {file = "curve.csv", compression = true}')
    assert [(p.d, p.q) for p in problem.control_points] == [(-10.0, -2.5), (-5.0, -1.0)]


def test_w_q_is_the_weight_of_the_points_that_have_none() -> None:
    text = "w_q = 3\ncontrol_points = [{d = 1, q = 2}, {d = 2, q = 3, weight = 4}]"
    assert [p.weight for p in SpringProblem.from_toml(text).control_points] == [3.0, 4.0]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('targets = "curve.csv"\ncontrol_points = [{d = 1, q = 2}]', "both targets and"),
        ('targets = "nowhere.csv"', "nowhere.csv"),
        ("targets = 3", "targets = 3"),
        ("targets = [{d = 1, q = 2}]", "points with their d and q are control_points"),
        ('targets = {path = "curve.csv"}', "must be the name of a CSV file"),
        ('targets = {file = "curve.csv", point = 3}', "did you mean 'points'"),
        ('targets = {file = "curve.csv", points = 2.5}', "targets.points = 2.5"),
        ('targets = {file = "curve.csv", at = 3}', "targets.at = 3"),
        ('targets = {file = "curve.csv", compression = 1}', "targets.compression = 1"),
        ('targets = {file = "curve.csv", specimen = true}', "targets.specimen = True"),
        ('targets = {file = "curve.csv", specimen = 2}', "no specimen 2"),
        ('targets = {file = "curve.csv", branch = "up"}', "branch = 'up'"),
        ('targets = {file = "curve.csv", branch = 3}', "branch = 3"),
        ('targets = {file = "curve.csv", quantities = "stress"}', "no columns strain and stress"),
        ('targets = "a\\u0000b"', "cannot be read"),
        ('targets = "curve.csv"\nH = 15', "only H = 15 mm"),
        ('targets = "curve.csv"\nH = "tall"', "H = 'tall'"),
        ('targets = "curve.csv"\nE = 1\nK = 2', "described twice"),
        ('targets = "curve.csv"\nw_q = "much"', "w_q = 'much'"),
        ("E = 1", "missing key 'control_points' (or 'targets')"),
    ],
)
def test_bad_targets_of_a_problem(folder: Path, text: str, part: str) -> None:
    with pytest.raises(ProblemError) as error:
        problem_of(folder, text)
    assert part in str(error.value)
    assert "spring.toml" in str(error.value)


def test_targets_are_read_beside_the_file_only(folder: Path) -> None:
    (folder / "below").mkdir()
    (folder / "below" / "curve.csv").write_text("d [mm],q [N]\n10,2\n-10,-2")
    for name in ("below/curve.csv", "below/../curve.csv"):
        assert problem_of(folder, f'targets = "{name}"').control_points
    spring = folder / "below" / "spring.toml"
    (folder / "below" / "link.csv").symlink_to(folder / "curve.csv")
    for name in ("../curve.csv", str(folder / "curve.csv"), "link.csv"):
        spring.write_text(f'targets = "{name}"\nE = 0.1')
        with pytest.raises(ProblemError, match="not in the folder of this file or below it"):
            SpringProblem.from_toml(spring)
        allowed = SpringProblem.from_toml(spring, targets_anywhere=True)
        assert [(p.d, p.q) for p in allowed.control_points] == PAIRS
    assert "--targets-anywhere" in invoke("targets", spring, code=2).stderr
    invoke("targets", spring, "--targets-anywhere", code=1)
    options = ("--max-updates", 0, "--threads", 1, "--out", folder / "run")
    assert "--targets-anywhere" in invoke("optimize", spring, *options, code=2).stderr
    assert "out of reach" in invoke("optimize", spring, "--targets-anywhere", code=2).stderr


SECRETS = [
    "root:x:0:0:/root",
    "token = hunter2",
    "user,hunter2\n12,13\n14,15",
    "12,13\nhunter2,root",
]


@pytest.mark.parametrize("secret", SECRETS)
def test_an_error_shows_no_line_of_a_file_that_is_no_curve(secret: str, folder: Path) -> None:
    (folder / "curve.csv").write_text(secret)
    with pytest.raises(ProblemError) as error:
        problem_of(folder, 'targets = "curve.csv"')
    message = str(error.value).partition("curve.csv")[2]
    assert "hunter2" not in message
    assert "root" not in message


@pytest.mark.long
def test_a_problem_with_targets_says_what_the_curve_says(folder: Path) -> None:
    up = np.linspace(0.1, 10, 40)
    loop = [
        (d, 0.2 * d + sign * np.sin(np.pi * d / 10) / 2) for sign in (1, -1) for d in up[::sign]
    ]
    rows = "\n".join(f"{d:.3f};{q:.4f}" for d, q in loop)
    (folder / "curve.csv").write_text(f"Weg [mm];Kraft [N]\n{rows}")
    (folder / "spring.toml").write_text('targets = "curve.csv"\nelements = 8\nl_i = 10')
    said = notes_of(invoke("targets", folder / "curve.csv").stdout)
    assert [note for note in said if "'Kraft [N]' is taken as q" in note]
    assert [note for note in said if "loading and unloading differ" in note]
    assert [note for note in said if "control points stand for 40 points" in note]
    assert said == notes_of(invoke("targets", folder / "spring.toml").stdout)
    options = ("--max-updates", 1, "--threads", 1, "--out", folder / "run")
    assert said == notes_of(invoke("optimize", folder / "spring.toml", *options).stderr)
    out = folder / "written.toml"
    invoke("targets", folder / "curve.csv", "--write", out)
    assert all(f"# {note}\n" in out.read_text() for note in said)


def notes_of(text: str) -> list[str]:
    """Notes on the curve; those on the targets come after them and begin with "from"."""
    notes = [line.partition("note: ")[2] for line in text.splitlines() if "note: " in line]
    return [note for note in notes if not note.startswith("from d = ")]


def test_a_design_file_names_no_other_file() -> None:
    from ngspring.problem.spring import SpringProblem

    with pytest.raises(ProblemError, match="does not come from a file"):
        SpringProblem.parse_toml('targets = "curve.csv"')


@pytest.mark.parametrize("name", [*cases, "small"])
def test_a_commented_file_describes_the_problem(name: str) -> None:
    small = scaled(cases["T2"], length=0.237, stress=3.1, thickness=7.7).replace(
        name='a "b"', p=7.0
    )
    problem = with_similar_weights(small if name == "small" else cases[name])
    again = SpringProblem.from_toml(annotated_toml(problem, "a\nfile"))
    assert (again.name, again.kinematics, again.elements, again.p) == (
        problem.name,
        problem.kinematics,
        problem.elements,
        problem.p,
    )
    for field in ("L", "H", "K", "G", "l_i", "l_t", "k_rho", "k_i", "k_H"):
        assert getattr(again, field) == pytest.approx(getattr(problem, field), rel=1e-6)
    for one, other in zip(again.control_points, problem.control_points, strict=True):
        for field in ("d", "q", "weight", "eta"):
            assert getattr(one, field) == pytest.approx(getattr(other, field), rel=1e-6)


# -- the command line ------------------------------------------------------------------------------


def test_a_small_rubber_spring_gets_weights_of_its_size(folder: Path) -> None:
    (folder / "curve.csv").write_text("d [mm],q [N]\n2,5\n-2,-5\n-4,-12.5")
    out = folder / "mine.toml"
    size = ("--length", 20, "--height", 20, "--thickness", 10, "--material", "silicone")
    result = invoke("targets", folder / "curve.csv", *size, "--write", out)
    assert "nothing speaks against this target" in result.stdout
    assert f"next: ngspring optimize {out}" in result.stdout
    problem = SpringProblem.from_toml(out)
    reference = scaled(cases["C6"], length=0.2, thickness=10.0)
    for field in ("L", "H", "T", "l_i", "l_t", "k_rho", "k_i", "k_H"):
        assert getattr(problem, field) == pytest.approx(getattr(reference, field), rel=1e-6)
    assert problem.name == "mine"
    assert [p.weight for p in problem.control_points] == pytest.approx(3 * [(20 / 50) ** 2])
    assert invoke("targets", out).stdout.splitlines()[0] == result.stdout.splitlines()[0]


def test_a_target_out_of_reach_is_code_1_and_optimize_refuses_it(folder: Path) -> None:
    (folder / "curve.csv").write_text("d,q\n10,20\n-10,-20")
    out = folder / "heavy.toml"
    result = invoke("targets", folder / "curve.csv", "--write", out, code=1)
    assert "error: q = 20 N at d = 10 mm is out of reach" in result.stdout
    written = result.stdout.splitlines()[-1]
    assert written.endswith(f"but ngspring optimize {out} will refuse it, unless --anyway is given")
    assert "next" not in written
    run = folder / "run"
    options = ("--elements", 8, "--max-updates", 1, "--threads", 1, "--out", run)
    refusal = invoke("optimize", out, *options, code=2)
    assert len(refusal.stderr.splitlines()) == 1
    assert "out of reach" in refusal.stderr
    assert "--anyway" in refusal.stderr
    assert not run.exists()
    tried = invoke("optimize", out, *options, "--anyway")
    assert "ngspring: warning: q = 20 N" in tried.stderr
    assert (run / "design.npz").exists()


def test_a_compression_test_is_turned_on_request(folder: Path) -> None:
    (folder / "curve.csv").write_text("d [mm],q [N]\n5,1\n10,2.5")
    assert "give --compression" in invoke("targets", folder / "curve.csv").stdout
    out = folder / "turned.toml"
    result = invoke("targets", folder / "curve.csv", "--compression", "--write", out)
    assert "note: --compression: both signs are turned" in result.stdout
    points = SpringProblem.from_toml(out).control_points
    assert [(p.d, p.q) for p in points] == [(-10.0, -2.5), (-5.0, -1.0)]


def test_small_strains_are_shown_with_their_digits(folder: Path) -> None:
    (folder / "curve.csv").write_text("d [mm],q [N]\n-0.02,-0.004\n0.54,0.1\n10,2")
    text = invoke("targets", folder / "curve.csv").stdout
    assert "-0.0002" in text
    assert "+0.0054" in text
    assert "+0.100" in text


def test_robust_adds_the_dilated_point_of_the_paper(folder: Path) -> None:
    (folder / "curve.csv").write_text("d,q\n10,2\n20,3")
    assert "needs a neck" in invoke("targets", folder / "curve.csv").stdout
    out = folder / "t1.toml"
    result = invoke("targets", folder / "curve.csv", "--robust", "--write", out)
    assert "neck" not in result.stdout
    problem, paper = SpringProblem.from_toml(out), cases["T1"]
    assert (problem.elements, problem.l_i) == (paper.elements, paper.l_i)
    weights = [p.weight for p in problem.control_points]
    assert weights[2] == pytest.approx(1e-4 * weights[1])
    assert [(p.d, p.q, p.eta) for p in problem.control_points] == [
        (p.d, p.q, p.eta) for p in paper.control_points
    ]


def test_a_dense_curve_says_how_well_its_points_stand_for_it(folder: Path) -> None:
    d = np.linspace(-20, 10, 300)
    rows = "\n".join(f"{a},{0.2 * a - 0.002 * a * a}" for a in d)
    (folder / "curve.csv").write_text("d [mm],q [N]\n" + rows)
    result = invoke("targets", folder / "curve.csv", "--points", 3)
    assert "note: 3 control points stand for" in result.stdout
    result = invoke("targets", folder / "curve.csv", "--at", "-20,-10,10")
    assert len([line for line in result.stdout.splitlines() if line.startswith("│")]) == 3


@pytest.mark.parametrize("name", ["C7", "a1"])
def test_a_case_can_be_checked_as_it_is(name: str) -> None:
    assert "nothing speaks against" in invoke("targets", name).stdout


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ("targets nowhere.csv", "nowhere.csv"),
        ("targets CURVE --at -20,ten", "--at '-20,ten'"),
        ("targets CURVE --at -50", "outside the curve"),
        ("targets CURVE --nu 0.5 --E 1", "nu = 0.5"),
        ("targets CURVE --E 1 --shore-a 30", "described twice"),
        ("targets CURVE --material rubbr", "did you mean 'natural rubber'"),
        ("targets CURVE --material nylon", "give its Young's modulus E"),
        ("targets CURVE --specimen 2", "no specimen 2"),
        ("targets CURVE --quantities stress", "no columns strain and stress"),
        ("targets C7 --branch mean", "checked as it is"),
        ("targets CURVE --height -3", "H = -3.0"),
        ("targets CURVE --elements 7", "elements = 7"),
        ("targets CURVE --kinematics axisymmetric --thickness 3", "no thickness"),
        ("targets CURVE --write FOLDER/spring", "must end with .toml"),
        ("targets CURVE --write FOLDER/there.toml", "exists already"),
        ("targets CURVE --write FOLDER/new/mine.toml", "new, make it first"),
        ("targets C7 --nu 0.3", "checked as it is"),
        ("targets C7 --compression", "checked as it is"),
    ],
)
def test_bad_input_is_one_line_and_code_2(folder: Path, arguments: str, part: str) -> None:
    (folder / "there.toml").write_text("")
    words = arguments.replace("CURVE", str(folder / "curve.csv")).replace("FOLDER", str(folder))
    result = invoke(*words.split(), code=2)
    assert len(result.stderr.splitlines()) == 1
    assert part in result.stderr
    assert (folder / "there.toml").read_text() == ""
    assert result.stdout == ""
    assert sorted(path.name for path in folder.iterdir()) == ["curve.csv", "there.toml"]


@pytest.mark.parametrize(
    ("options", "lines", "hardness"),
    [
        (("--shore-a", 40), ["shore_A = 40"], 40.0),
        (("--shore-a", 62.5, "--nu", 0.45), ["shore_A = 62.5", "nu = 0.45"], 62.5),
        (("--material", "silicone"), ['material = "silicone"'], 30.0),
        (("--material", "NBR", "--shore-a", 45), ['material = "NBR"', "shore_A = 45"], 45.0),
    ],
)
def test_the_written_file_has_the_stiffness_as_it_was_given(
    options: tuple[object, ...], lines: list[str], hardness: float, folder: Path
) -> None:
    out = folder / "mine.toml"
    invoke("targets", folder / "curve.csv", *options, "--write", out)
    keys = [line.partition("#")[0].strip() for line in out.read_text().splitlines()]
    assert set(lines) <= set(keys)
    assert not [key for key in keys if key.startswith("E =")]
    nu = 0.45 if 0.45 in options else 0.4
    problem = SpringProblem.from_toml(out)
    assert bulk_and_shear_modulus(young_from_shore_A(hardness), nu) == (problem.K, problem.G)


def test_materials_are_listed_with_hardness_and_modulus() -> None:
    text = invoke("materials").stdout
    for part in ("silicone", "natural rubber", "TPU", "Shore A", "E [MPa]", "Gent"):
        assert part in text


# -- drawings --------------------------------------------------------------------------------------

CURVES = {
    "path": '<path d="M 0 100 L 200 0"/>',
    "polyline": '<polyline points="0,100 50,75 200,0"/>',
    "line": '<line x1="0" y1="100" x2="200" y2="0"/>',
    "cubic": '<path d="M 0 100 C 50 75 150 25 200 0"/>',
    "moved": '<g transform="translate(-10 5)"><path d="m 10 95 l 200 -100"/></g>',
}


def drawing(*shapes: str, page: str = 'width="200" height="100"') -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" {page}>{"".join(shapes)}</svg>'


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("page", ['width="200" height="100"', 'viewBox="0 0 200 100" width="70mm"'])
def test_a_diagonal_of_the_page_is_a_linear_spring(curve: str, page: str, tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "curve.SVG"
    path.write_text(drawing(CURVES[curve], page=page))
    drawn = read_curve(path, *size_of(SPRING), ((-20.0, 20.0), (-4.0, 4.0)))
    assert drawn.range == pytest.approx((-20.0, 20.0))
    d = np.linspace(-20, 20, 9)
    assert drawn.force(np.clip(d, *drawn.range)) == pytest.approx(0.2 * d, abs=1e-6)


def test_one_of_several_drawn_curves_is_chosen(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "curve.svg"
    path.write_text(drawing('<path d="M 0 100 L 200 0 M 0 100 L 200 50"/>', CURVES["line"]))
    for specimen, force in ((1, 4.0), (2, 2.0), (3, 4.0)):
        drawn = read_curve(path, *size_of(SPRING), ((0, 20), (0, 4)), specimen=specimen)
        assert drawn.force(20.0) == pytest.approx(force)


def test_a_rectangle_is_the_axes(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "curve.svg"
    frame = '<rect x="50" y="20" width="100" height="40"/>'
    path.write_text(drawing(frame, '<path d="M 50 60 L 150 20"/>'))
    drawn = read_curve(path, *size_of(SPRING), ((0.0, 10.0), (0.0, 2.0)))
    assert drawn.force(5.0) == pytest.approx(1.0)
    assert drawn.range[1] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (drawing(), "0 paths"),
        (drawing(CURVES["path"], CURVES["line"]), "holds 2 curves .*--specimen 1 to 2"),
        (drawing('<path d="M 0 100 L 200 0 M 0 50 L 200 50"/>'), "holds 2 curves"),
        (drawing('<path d="M 1 1"/>'), "no length"),
        ("d,q\n1,2", "not a valid SVG"),
        ("<svg", "not a valid SVG"),
    ],
)
def test_a_drawing_has_one_curve(text: str, part: str, tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "curve.svg"
    path.write_text(text)
    with pytest.raises(ProblemError, match=part):
        read_curve(path, *size_of(SPRING), ((0.0, 10.0), (0.0, 2.0)))
    with pytest.raises(ProblemError, match="ranges of d and q"):
        read_curve(path, *size_of(SPRING))
    with pytest.raises(ProblemError, match="must increase"):
        read_curve(path, *size_of(SPRING), ((0.0, 10.0), (2.0, 0.0)))


def test_a_drawn_curve_becomes_a_problem(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path, out = tmp_path / "curve.svg", tmp_path / "drawn.toml"
    path.write_text(drawing('<path d="M 0 100 C 60 70 140 40 200 0"/>'))
    ranges = ("--d-range", "-20,20", "--q-range", "-4,4")
    invoke("targets", path, *ranges, "--points", 4, "--write", out)
    points = SpringProblem.from_toml(out).control_points
    assert [p.d for p in points] == [-20.0, -10.0, 10.0, 20.0]
    assert [points[0].q, points[-1].q] == pytest.approx([-4.0, 4.0])
    assert "needs --d-range" in invoke("targets", path, code=2).stderr
    assert "two numbers" in invoke("targets", path, *ranges[:3], "1", code=2).stderr
