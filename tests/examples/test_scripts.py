"""The three short scripts beside the reproduction, on coarse meshes: they end where they should."""

from __future__ import annotations

import importlib
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from matplotlib.image import imread

import ngspring

EXAMPLES = Path(__file__).parents[2] / "examples"
pytestmark = pytest.mark.skipif(not EXAMPLES.is_dir(), reason="the examples are not installed")


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("optimize", "load_displacement", "verify"):
        monkeypatch.setattr(ngspring, name, partial(getattr(ngspring, name), threads=1))


@pytest.fixture
def script(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module(request.param)


def targets(result: ngspring.Result) -> list[float]:
    return [point.q for point in result.design.problem.control_points]


def has_ink(picture: Path) -> bool:
    values: Any = imread(picture)
    return bool(values[..., :3].min() < 0.1)


@pytest.mark.long
@pytest.mark.parametrize("script", ["my_own_spring"], indirect=True)
def test_my_own_spring_meets_its_targets(script: ModuleType, tmp_path: Path) -> None:
    result = script.main(elements=10, picture=tmp_path / "spring.png")
    assert result.q == pytest.approx(targets(result), rel=1e-4)
    assert has_ink(tmp_path / "spring.png")


@pytest.mark.long
@pytest.mark.parametrize("script", ["from_a_measured_curve"], indirect=True)
def test_a_measured_curve_becomes_a_spring_that_meets_it(
    script: ModuleType, tmp_path: Path
) -> None:
    result = script.main(elements=10, out=tmp_path)
    # What the file says at -8, -4 and 4 mm.
    assert result.q == pytest.approx([-59.90, -39.99, 40.18], rel=1e-4)
    assert has_ink(tmp_path / "from_a_measured_curve.png")
    saved = ngspring.Design.load(tmp_path / "from_a_measured_curve.npz")
    assert saved.problem == result.design.problem


@pytest.mark.parametrize("script", ["from_a_design_to_a_part"], indirect=True)
def test_a_stored_design_becomes_files_of_its_size(
    script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome = script.main("C4", displacements=[1.0], out=tmp_path)
    assert outcome.smallest_wall == pytest.approx(7.1, abs=0.05)
    assert (tmp_path / "C4.step").read_text().startswith("ISO-10303-21;")
    assert "<svg" in (tmp_path / "C4.svg").read_text()
    # W/H = 0.2189 of 100 x 100 x 1 mm.
    assert "C4.step: 2189 mm^3" in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_is_short_and_uses_public_names_only(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line]) <= 30
    assert "ngspring._" not in text
    assert "from ngspring." not in text
