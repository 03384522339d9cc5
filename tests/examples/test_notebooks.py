"""The notebooks run from end to end in a fresh kernel, and say what they are meant to show.

The scripts in percent format are executed, not the stored .ipynb files; those must have the same
cells and carry pictures.
"""

from __future__ import annotations

import base64
import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

# Imported where they are used: it takes seconds that everybody who collects the tests would pay.
if missing := [
    name
    for name in ("jupytext", "nbformat", "nbclient", "ipykernel")
    if importlib.util.find_spec(name) is None
]:
    pytest.skip(f"{missing[0]} is not installed", allow_module_level=True)

FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="the examples are not installed")
#: Seconds for a notebook, which takes less than one minute on a free core.
LONGEST = 240
LARGEST_FILE = 1_500_000
PNG = b"\x89PNG\r\n\x1a\n"

# By notebook: expressions of its variables, each with the least and the largest value.
NUMBERS: dict[str, dict[str, tuple[float, float]]] = {
    # The slit closes to less than a thousandth; the stiffness rises a hundredfold; without k_r the
    # void folds over.
    "01_third_medium_contact": {
        "film": (1e-5, 1e-3),
        "slope_after / slope_before": (50, 200),
        "folded": (-20, -1),
    },
    # Slopes of the Taylor test, symmetry of Newton's matrix, target force reached.
    "02_lagrangian": {
        "test.first_order": (1.95, 2.05),
        "test.second_order": (2.9, 3.1),
        "asymmetry": (0, 1e-12),
        "force[-1]": (-2.001, -1.999),
    },
    "03_design_your_own": {"float(result.converged)": (1, 1), "missed": (0, 1e-3)},
    # The solid is stiffer, as in Fig. 13; the triangles enclose the volume of the section.
    "04_density_to_part": {
        "deviation": (0.02, 0.1),
        "enclosed / exported.measure": (0.999, 1.001),
        "-band.sensitivity(-20.0)": (0.5, 5),
    },
    # Solid neck with the dilated control point, grey layer without.
    "05_robust": {
        "density_of_neck['robust']": (0.99, 1),
        "density_of_neck['not robust']": (0.1, 0.9),
    },
    # Exact but for the void's E_0; Eq. 25 as examples/paper/README.md has it.
    "07_part": {"worst": (0, 0.005), "stretches[1] / 1.12": (0.9, 1.05)},
    # The stored part by real contact, computed anew; and what was found of an imperfect one.
    "08_from_a_test_to_a_part": {
        "max(abs(curve.q[places.index(p.d)] / p.q - 1) for p in own)": (0, 0.007),
        "float(curve.stretch_measure.max())": (1.2, 1.575),
        "float(moved['stable'])": (1, 1),
        "exported.measure / (15 * 40 * 40 * part.relative_width)": (0.97, 1.03),
    },
    "06_axisymmetric": {"max(relative)": (0, 2e-6), "D / H": (0.4091, 0.4093)},
}


def load_render() -> ModuleType:
    spec = importlib.util.spec_from_file_location("render", FOLDER / "render.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_all_notebooks_are_checked() -> None:
    assert [path.stem for path in load_render().scripts()] == sorted(NUMBERS)


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_notebook_runs_and_its_numbers_are_right(name: str) -> None:
    asked = ", ".join(f"float({expression})" for expression in NUMBERS[name])
    extra = f"import json\nprint(json.dumps([{asked}]))"
    notebook = load_render().execute(FOLDER / f"{name}.py", extra, LONGEST)
    values = json.loads(notebook.cells[-1].outputs[-1].text.splitlines()[-1])
    for (expression, (low, high)), value in zip(NUMBERS[name].items(), values, strict=True):
        assert low <= value <= high, f"{expression} = {value} is not in [{low}, {high}]"


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_stored_notebook_is_in_step_with_its_script(name: str) -> None:
    import jupytext
    import nbformat

    script = jupytext.read(FOLDER / f"{name}.py")
    stored = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(stored)
    cells = [(cell.cell_type, cell.source) for cell in script.cells]
    assert [(cell.cell_type, cell.source) for cell in stored.cells] == cells


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_stored_notebook_shows_pictures_without_being_run(name: str) -> None:
    path = FOLDER / f"{name}.ipynb"
    assert path.stat().st_size < LARGEST_FILE
    import nbformat

    stored = nbformat.read(path, as_version=4)
    code = [cell for cell in stored.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code)
    outputs = [output for cell in code for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    pictures = [o.data["image/png"] for o in outputs if "image/png" in o.get("data", {})]
    assert len(pictures) >= 3
    assert all(base64.b64decode(picture).startswith(PNG) for picture in pictures)
    scenes = [o for o in outputs if "application/vnd.jupyter.widget-view+json" in o.get("data", {})]
    assert scenes, "no interactive picture (NGSolve's Draw)"


@pytest.mark.long
def test_a_notebook_that_hangs_is_given_up(tmp_path: Path) -> None:
    from nbclient.exceptions import CellTimeoutError

    script = tmp_path / "hangs.py"
    script.write_text("# %%\nimport time\n\n# %%\ntime.sleep(600)\n")
    with pytest.raises(CellTimeoutError):
        load_render().execute(script, longest=2)
