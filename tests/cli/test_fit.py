"""``ngspring fit``: from files of tests to a file that a problem takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands import invoke

from ngspring import SpringProblem, fit
from ngspring.problem.laws import Yeoh

DATA = Path(__file__).parents[1] / "problem" / "material-tests"
UNIAXIAL, PLANAR = DATA / "treloar-uniaxial.csv", DATA / "treloar-planar.csv"
POINT = "[[control_points]]\nd = 10\nq = 0.5\n"


@pytest.mark.long
def test_a_law_goes_from_tests_into_a_problem(tmp_path: Path) -> None:
    out = tmp_path / "material.toml"
    command = ("fit", UNIAXIAL, "--planar", PLANAR, "--law", "yeoh", "--stretches", "1.05,3")
    result = invoke(*command, "--write", out)
    assert "treloar-uniaxial.csv: uniaxial, 7 points, stretches 1.125 to 2.42" in result.output
    assert "treloar-planar.csv: planar, 7 points" in result.output
    assert "stable for stretches" in result.output
    assert (tmp_path / "material.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "spring.toml").write_text(f'material = "material.toml"\n{POINT}')
    law = SpringProblem.from_toml(tmp_path / "spring.toml").law
    found = fit([UNIAXIAL, PLANAR], "yeoh", stretches=(1.05, 3.0)).law
    assert isinstance(law, Yeoh)
    assert list(law.parameters.values()) == pytest.approx(list(found.parameters.values()), 1e-6)
    # And into a problem that is made of a curve.
    curve = tmp_path / "curve.csv"
    curve.write_text("d [mm],q [N]\n5,0.2\n10,0.5\n")
    invoke("targets", curve, "--material", out, "--write", tmp_path / "made.toml")
    assert SpringProblem.from_toml(tmp_path / "made.toml").law == law


@pytest.mark.long
def test_laws_are_compared(tmp_path: Path) -> None:
    picture = tmp_path / "all.svg"
    result = invoke("fit", DATA / "meunier-silicone.csv", "--law", "all", "--picture", picture)
    rows = [line for line in result.output.splitlines() if "%" in line]
    assert "ogden-2" in rows[0]
    assert len(rows) == 8
    assert "<svg" in picture.read_text()


def test_measured_silicones_are_listed() -> None:
    output = invoke("materials").output
    assert "Ecoflex 00-30" in output
    assert "Soft Robotics 8 (2021)" in output


@pytest.mark.parametrize(
    ("command", "part"),
    [
        ("fit", "name a CSV file of a test"),
        ("fit FOLDER/none.csv", "No such file"),
        ("fit FOLDER", "is a directory"),
        ("fit PLANAR --law yeo", "'yeo' is not one of"),
        ("fit PLANAR --nu 0.6", "nu = 0.6"),
        ("fit PLANAR --nu nan", "nan"),
        ("fit PLANAR --stretches 1", "--stretches '1' must be two numbers, as 0.7,2.5"),
        ("fit PLANAR --stretches a,b", "--stretches 'a,b' must be two numbers"),
        ("fit PLANAR --stretches 8,9", "fewer than two points have stretches from 8 to 9"),
        ("fit PLANAR --law all --write FOLDER/a.toml", "name one of them"),
        ("fit PLANAR --write FOLDER/a.csv", "must end with .toml"),
        ("fit PLANAR --write FOLDER/there.toml", "exists already"),
        ("fit PLANAR --picture FOLDER/a.doc", "suffix of a picture"),
        ("fit FOLDER/there.toml", "there.toml"),
        ("fit PLANAR --specimen 2", "there is no specimen 2"),
        ("fit --equibiaxial FOLDER/one.csv", "1 points apart from rest"),
    ],
)
def test_bad_input_is_one_line(command: str, part: str, tmp_path: Path) -> None:
    (tmp_path / "there.toml").write_text("")
    (tmp_path / "one.csv").write_text("strain;stress\n0.5;0.09\n")
    words = [
        word.replace("PLANAR", str(PLANAR)).replace("FOLDER", str(tmp_path))
        for word in command.split()
    ]
    result = invoke(*words, code=2)
    complaints = result.stderr.splitlines()
    assert len(complaints) == 1
    assert part in complaints[0]
