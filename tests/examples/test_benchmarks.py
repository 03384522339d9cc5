"""The benchmark beside GetFEM: what is handed over, what is compared, and what is told of it."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from ngspring.evolution.bench import PARTS
from ngspring.kkt.bench import bench_problem
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import Timings

FOLDER = Path(__file__).parents[2] / "examples" / "benchmarks"
GETFEM = "/usr/bin/python3"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="the examples are not installed")


def load(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(FOLDER)
    return importlib.import_module(name)


@pytest.fixture
def exchange(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("exchange", monkeypatch)


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("tables", monkeypatch)


@pytest.fixture
def measure(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("measure", monkeypatch)


@pytest.fixture(scope="module")
def system() -> CoupledSystem:
    return CoupledSystem(bench_problem(8), "sparsecholesky")


def some_state(system: CoupledSystem) -> State:
    random = np.random.default_rng(3)
    points = len(system.points)
    chi = random.normal(size=system.coefficients)
    u = 0.1 * random.normal(size=(points, system.free))
    return State(chi, u, random.normal(size=(points, system.free + 1)))


def test_nodes_move_as_the_field_does(exchange: ModuleType, system: CoupledSystem) -> None:
    state, d = some_state(system), 3.0
    nx, ny = system.grid.cells
    nodal = exchange.nodal_values(system) @ np.append(state.u[0], d)
    u_x, u_y = nodal.reshape(2, 2 * nx + 1, 2 * ny + 1)
    # The conditions of 2.5 on the quarter.
    assert np.ptp(u_x[0]) == pytest.approx(0.0, abs=1e-12)
    assert u_x[-1] == pytest.approx(0.0, abs=1e-12)
    assert u_y[:, 0] == pytest.approx(0.0, abs=1e-12)
    assert u_y[:, -1] == pytest.approx(d / 2)
    # A node in the middle of a cell is no vertex: only there do NGSolve's bubbles count.
    import ngsolve as ng

    field = ng.GridFunction(ng.VectorH1(system.grid.mesh, order=2))
    field.vec.FV().NumPy()[:] = system.images[0].copies[0].matrix @ np.append(state.u[0], d)
    width, height = system.grid.size
    place = system.grid.mesh(width * 3 / (2 * nx), height * 5 / (2 * ny))
    assert field(place) == pytest.approx((u_x[3, 5], u_y[3, 5]))


def test_the_file_holds_what_the_paper_names(
    exchange: ModuleType, system: CoupledSystem, tmp_path: Path
) -> None:
    state = some_state(system)
    exchange.write_state(tmp_path / "state.npz", system, state, 0.5 * state.chi, 10.0)
    with np.load(tmp_path / "state.npz") as file:
        given = json.loads(str(file["parameters"]))
        assert file["u"].shape == file["lam"].shape == (3, 2, 9, 9)
        assert file["chi"].ravel() == pytest.approx(state.chi)
        assert file["chi_old"].ravel() == pytest.approx(0.5 * state.chi)
    assert given["points"][2] == {"d": -20.0, "q": -5.5, "w": 1.0, "eta": 0.0}
    assert (given["cells"], given["dt"], given["l_i"]) == ([4, 4], 10.0, 10.0)


def test_only_the_quarter_in_plane_strain_is_compared(exchange: ModuleType, tmp_path: Path) -> None:
    full = CoupledSystem(bench_problem(4, 1, "full"), "sparsecholesky")
    state = some_state(full)
    with pytest.raises(SystemExit, match="quarter"):
        exchange.write_state(tmp_path / "state.npz", full, state, state.chi, 1.0)


ITERATION = {"assembly": 1.0, "linear": 2.0, "residual": 0.5, "unknowns": 1234, "memory": 0.5}


def pair(ours: list[float], theirs: list[float]) -> dict[str, Any]:
    return {
        "elements": 40,
        "threads": 1,
        "agreement": {"residual": {"chi": 1e-13}, "update": {"chi": 2e-10, "u": 1e-11}},
        "ours": [{"iteration": t, "cpu": 0.5, **ITERATION} for t in ours],
        "theirs": [{"iteration": t, "cpu": 2.1, **ITERATION} for t in theirs],
    }


def whole_run(**changes: Any) -> dict[str, Any]:
    run = {"elements": 40, "threads": 1, "rule": "paper", "seconds": 60.0, "updates": 90}
    run |= {"iterations": 290, "rejected_iterations": 10, "message": "converged", "width": 0.25}
    return {
        **run,
        "memory": 0.4,
        "parts": {**dict.fromkeys(PARTS, 0.0), "assembly": 45.0},
        **changes,
    }


def test_ratios_are_of_pairs_measured_in_turn(tables: ModuleType) -> None:
    # The machine was twice as slow in the second round: the ratio does not feel it.
    assert tables.ratios(pair([0.5, 1.0, 0.4], [2.0, 4.0, 2.0])) == pytest.approx([4.0, 4.0, 5.0])
    text = tables.pairs_table({"pairs": [pair([0.5, 1.0, 0.4], [2.0, 4.0, 2.0])]})
    assert text.splitlines()[-1] == (
        "| 40 x 40 | 1 | 0.50 s | 2.00 s | 4.0, 4.0, 5.0 | **4.0** | 4.2 |"
    )


def test_without_getfem_the_tables_tell_of_ngspring_alone(tables: ModuleType) -> None:
    alone = pair([0.5], [])
    del alone["theirs"], alone["agreement"]
    assert tables.pairs_table({"pairs": [alone]}).splitlines()[-1].count(" - ") == 4
    assert "not been compared" in tables.agreement_line({"pairs": [alone]})
    assert "GetFEM" not in tables.parts_table({"pairs": [alone]})


def test_an_estimated_run_says_so_and_gives_way_to_a_real_one(tables: ModuleType) -> None:
    results = {"pairs": [pair([0.5], [2.0])], "runs": [whole_run()]}
    last = tables.runs_table(results).splitlines()[-1]
    # 300 iterations of 2 s.
    assert "GetFEM, estimated" in last
    assert "600 s" in last
    results["their_runs"] = [whole_run(seconds=700.0, message="out of time")]
    text = tables.runs_table(results)
    assert "estimated" not in text
    assert "GetFEM, run (out of time)" in text


def test_runs_that_ended_are_compared_by_their_design(tables: ModuleType) -> None:
    results = {"runs": [whole_run()], "their_runs": [whole_run(width=0.25 * (1 + 3e-9))]}
    assert "40 x 40 elements: their W/H differ by 3e-09" in tables.ends_line(results)
    results["their_runs"][0]["message"] = "out of time"
    assert "No run of both" in tables.ends_line(results)


def test_shares_of_a_run_are_of_its_seconds(tables: ModuleType) -> None:
    text = tables.where_table({"runs": [whole_run()]})
    assert "| assembly | 75% |" in text
    assert "pictures" not in text


def test_growth_says_where_a_code_gave_up(tables: ModuleType) -> None:
    mesh = pair([0.5], [])
    mesh |= {"theirs_failed": "error -9"}
    del mesh["theirs"]
    assert "| error -9 | - |" in tables.growth_table({"growth": [mesh]})


def test_only_marked_parts_of_a_page_change(tables: ModuleType) -> None:
    page = "Before\n<!-- pairs -->\nold\n<!-- end pairs -->\nafter\n"
    machine = {"processors": 2, "model": "M", "load": 0.1, "ngsolve": "6", "solver": "s"}
    results = {"machine": {**machine, "getfem": "G"}, "pairs": [pair([0.5], [2.0])]}
    text = tables.filled(page, results)
    assert text.startswith("Before\n<!-- pairs -->\n| elements")
    assert text.endswith("\n<!-- end pairs -->\nafter\n")
    assert "old" not in text
    assert tables.filled(text, results) == text


def test_pages_show_the_stored_results(tables: ModuleType) -> None:
    results = json.loads(tables.RESULTS.read_text(encoding="utf-8"))
    for page in tables.PAGES:
        text = page.read_text(encoding="utf-8")
        assert tables.filled(text, results) == text


def test_a_code_that_fails_says_why(measure: ModuleType) -> None:
    code = measure.Code([sys.executable, "-c", 'print(\'{"error": "no"}\')'], 1)
    with pytest.raises(measure.CodeError, match="no"):
        code.answer()
    with pytest.raises(measure.CodeError, match="exit code 0"):
        code.answer()
    code.close()


def test_a_python_without_getfem_is_known(measure: ModuleType, tmp_path: Path) -> None:
    assert not measure.has_getfem(str(tmp_path / "python"))


def test_codes_that_disagree_are_not_timed(measure: ModuleType, tmp_path: Path) -> None:
    class Fake:
        def ask(self, do: str, **arguments: object) -> dict[str, Any]:
            return {"residual": {"chi": 1e-12}, "update": {"chi": 1e-3}}

    with pytest.raises(measure.CodeError, match=r"disagree: update by 1\.0e-03"):
        measure.agreement(Fake(), Fake(), tmp_path)


def test_parts_of_an_iteration_are_timed_by_name(
    system: CoupledSystem, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    module = load("ngspring_code", monkeypatch)
    code = module.Code(8, 1, tmp_path / "state.npz")
    assert code.prepare()["first"] > 0
    found = code.iterate()
    parts = sum(found[name] for name in ("assembly", "linear", "residual"))
    assert 0 < parts < found["iteration"]
    assert found["unknowns"] == system.unknowns
    assert isinstance(code.system.timings, Timings)


@pytest.mark.slow
def test_getfem_has_the_same_residual_and_the_same_update(measure: ModuleType) -> None:
    if not measure.has_getfem(GETFEM):
        pytest.skip(f"{GETFEM} has no GetFEM (python3-getfem)")
    found = measure.pairs(40, 1, 1, GETFEM)
    assert max(found["agreement"]["residual"].values()) < 1e-8
    assert max(found["agreement"]["update"].values()) < 1e-6
    # q, u_Ty and the multiplier of each are unknowns there.
    assert found["theirs"][0]["unknowns"] == found["ours"][0]["unknowns"] + 9
