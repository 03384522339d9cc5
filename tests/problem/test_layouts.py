"""Files of test machines and other programs: where the header is, and what it means."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.curve import TargetCurve, parse_curve

HEIGHT, AREA = 40.0, 400.0
PAIRS = [(0.5, 0.25), (1.0, 0.55), (2.0, 1.2)]


def read(text: str, specimen: int | None = None, quantities: str | None = None) -> TargetCurve:
    return parse_curve(text, HEIGHT, AREA, specimen=specimen, quantities=quantities)


def pairs_of(curve: TargetCurve) -> np.ndarray:
    return np.column_stack([curve.d, curve.q])


@pytest.mark.parametrize(
    "text",
    [
        '"Gauge length","40.0",mm\n\nTime,Extension,Load\n(s),(mm),(N)\n'
        '"0.1","0.5","0.25"\n"0.2","1.0","0.55"\n"0.3","2.0","1.2"\n',
        "Extension,Load\n(mm),(N)\n0.5,0.25\n1,0.55\n2,1.2",
        "Extension\tLoad\nmm\tkN\n0,5\t0,00025\n1,0\t0,00055\n2,0\t0,0012",
        "sep=;\nd [mm];q [N]\n0,5;0,25\n1;0,55\n2;1,2",
        '"sep=\t"\r\nd [mm]\tq [N]\r\n0.5\t0.25\r\n1\t0.55\r\n2\t1.2\r\n',
        "% Model: spring\n% Version: 6.1\n% disp (mm)      force (N)\n0.5 0.25\n1.0 0.55\n2.0 1.20",
        "# force [kN] displacement [m]\n0.00025 0.0005\n0.00055 0.0010\n0.00120 0.0020",
        "#d,q\n0.5,0.25\n1,0.55\n2,1.2",
        "# a note\n0.5,0.25\n1,0.55\n2,1.2",
        ",displacement (mm),force (N)\n0,0.5,0.25\n1,1.0,0.55\n2,2.0,1.2",
        "Time measurement (s),Primary load (N),Extension (mm)\n0,0.25,0.5\n1,0.55,1\n2,1.2,2",
        '"Weg [mm]","Kraft [N]"\n"0,5","0,25"\n"1,0","0,55"\n"2,0","1,2"',
        "2024-01-05 12:30\nsize,40,40,10\n40;10\nd;q\n0.5;0.25\n1;0.55\n2;1.2",
        "clock,d,q\n10:00:01.5,0.5,0.25\n10:00:02.5,1,0.55\n10:00:03.5,2,1.2",
        "mm,N\n0.5,0.25\n1,0.55\n2,1.2",
        "d [µm];F [µN]\n500;250000\n1000;550000\n2000;1200000",
        "d [μm];F [mN]\n500;250\n1000;550\n2000;1200",
        "Extension [%],Stress [Pa]\n1.25,625\n2.5,1375\n5,3000",
        "strain [m/m],stress [N/mm²]\n0.0125,0.000625\n0.025,0.001375\n0.05,0.003",
        "Compressive displacement (mm),Compressive force (N)\n-0.5,-0.25\n-1,-0.55\n-2,-1.2",
        "d,q\n\N{MINUS SIGN}0.5,\N{MINUS SIGN}0.25\n-1,-0.55\n-2,-1.2",
    ],
)
def test_the_same_curve_in_the_layouts_of_many_programs(text: str) -> None:
    found = np.abs(pairs_of(read(text)))
    assert found[found[:, 0].argsort()] == pytest.approx(np.array(PAIRS), rel=1e-12)


@pytest.mark.parametrize(
    ("header", "d", "q"),
    [
        ("Displacement (in.),Force (lbs)", 25.4, 4.4482216152605),
        ("Displacement (inch),Force (lb)", 25.4, 4.4482216152605),
        ("mm,gf", 1.0, 9.80665e-3),
        ("d [mm],F [kp]", 1.0, 9.80665),
        ("strain [-],stress [kgf/cm2]", HEIGHT, 0.0980665 * AREA),
        ("strain [%],stress [kg/cm²]", HEIGHT / 100, 0.0980665 * AREA),
    ],
)
def test_units_of_other_countries(header: str, d: float, q: float) -> None:
    # Tension of 0.5 and 0.5 of each unit.
    assert pairs_of(read(f"{header}\n0.5,0.5")) == pytest.approx(np.array([[d / 2, q / 2]]))


def test_a_unit_that_is_not_known_is_refused_by_name() -> None:
    with pytest.raises(
        ProblemError, match=r"unit 'g' of column 'q \[g\]' is not one of N, kN, .*gf"
    ):
        read("d [mm],q [g]\n1,2")


# -- several specimens -----------------------------------------------------------------------------

SPECIMENS = [
    "Displacement (mm),Force (N),Displacement (mm).1,Force (N).1\n1,0.4,1,0.8\n2,0.9,2,1.8",
    "Displacement,Force,Displacement,Force\n1,0.4,1,0.8\n2,0.9,2,1.8",
    "Weg [mm];Kraft [N];Weg [mm];Kraft [N]\n1;0,4;1;0,8\n2;0,9;2;1,8",
    "Weg 1 [mm];Kraft 1 [N];Weg 2 [mm];Kraft 2 [N]\n1;0,4;1;0,8\n2;0,9;2;1,8",
    "Extension 1 (mm),Load 1 (N),Extension 2 (mm),Load 2 (N)\n1,0.4,1,0.8\n2,0.9,2,1.8",
    "A,,B,\nExtension,Load,Extension,Load\nmm,N,mm,N\n1,0.4,1,0.8\n2,0.9,2,1.8",
    "d [mm],Force (N),Force (N).1\n1,0.4,0.8\n2,0.9,1.8",
    "A\nd,q\n(mm),(N)\n1,0.4\n2,0.9\n\nB\nd,q\n(mm),(N)\n1,0.8\n2,1.8\n",
]


@pytest.mark.parametrize("text", SPECIMENS)
def test_one_of_several_specimens_is_chosen_and_never_in_silence(text: str) -> None:
    with pytest.raises(ProblemError, match=r"holds 2 curves .*--specimen 1 to 2"):
        read(text)
    assert pairs_of(read(text, 1)).tolist() == [[1.0, 0.4], [2.0, 0.9]]
    assert pairs_of(read(text, 2)).tolist() == [[1.0, 0.8], [2.0, 1.8]]
    for none in (0, 3):
        with pytest.raises(ProblemError, match=f"no specimen {none}: the file holds 2"):
            read(text, none)


def test_specimens_may_have_different_numbers_of_rows() -> None:
    text = "d,q,d.1,q.1\n1,0.4,1,0.8\n2,0.9,,\n3,1.2,,\n"
    assert len(read(text, 1).d) == 3
    assert pairs_of(read(text, 2)).tolist() == [[1.0, 0.8]]


# -- strain and stress -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "strain", "stress"),
    [
        ("stretch [-],stress [MPa]", lambda e: 1 + e, lambda e, s: s),
        ("λ,σ [MPa]", lambda e: 1 + e, lambda e, s: s),
        ("True strain [-],True stress [MPa]", np.log1p, lambda e, s: s * (1 + e)),
        ("Logarithmic strain [-],stress [MPa]", np.log1p, lambda e, s: s),
        ("stretch ratio [-],Cauchy stress [MPa]", lambda e: 1 + e, lambda e, s: s * (1 + e)),
        ("Engineering strain [-],True stress [MPa]", lambda e: e, lambda e, s: s * (1 + e)),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stretch_and_true_measures_become_nominal(
    header: str, strain: object, stress: object, sign: float
) -> None:
    e, s = sign * np.array([0.05, 0.1, 0.2, 0.3]), sign * np.array([0.005, 0.01, 0.02, 0.03])
    columns = np.column_stack([strain(e), stress(e, s)])
    rows = "\n".join(f"{a!r},{b!r}" for a, b in columns.tolist())
    curve = read(f"{header}\n{rows}")
    order = np.argsort(e)
    assert curve.d == pytest.approx(HEIGHT * e[order], rel=1e-12)
    assert curve.q == pytest.approx(AREA * s[order], rel=1e-12)
    assert any("stretch" in r or "nominal" in r for r in curve.remarks)


def test_of_both_kinds_of_columns_it_is_said_which_are_taken() -> None:
    text = (
        "Displacement (mm),Force (N),Strain (%),Stress (MPa)\n0.25,0.3,5,0.005\n0.5,0.6,10,0.01\n"
    )
    by_default = read(text)
    assert pairs_of(by_default).tolist() == [[0.25, 0.3], [0.5, 0.6]]
    assert "displacement and force are taken" in by_default.remarks[0]
    assert pairs_of(read(text, quantities="force")).tolist() == [[0.25, 0.3], [0.5, 0.6]]
    assert pairs_of(read(text, quantities="stress")) == pytest.approx(np.array([[2, 2], [4, 4.0]]))
