"""Every figure of the paper is drawn, shows what it says, and returns the numbers of its text.

The stored designs are checked for real, where that takes seconds; for the arrangement of the
pictures columns on 8 x 8 elements stand in for them.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import ngspring.view.design
from ngspring import Design, Response, gallery, load_displacement, parts
from ngspring.analysis.finished import responses_in_gallery
from ngspring.campaign.plan import Run
from ngspring.problem.scaling import on_mesh

PAPER = Path(__file__).parents[2] / "examples" / "paper"
pytestmark = pytest.mark.skipif(not PAPER.is_dir(), reason="the examples are not installed")

FAMILIES = {
    "4": tuple(f"C{i}" for i in range(1, 8)),
    "6": tuple(f"T{i}" for i in range(1, 7)),
    "8": ("CT1", "CT2", "CT3"),
    "9": ("CT4", "CT5", "CT6"),
    "10": ("A1", "A2"),
    "11": ("A3", "A4"),
    "14": ("T1", "T1-not-robust", "T2", "T2-not-robust"),
}
NAMES = sorted({"C7-random"}.union(*FAMILIES.values()))
# What the paper, or our own run, says; a design without an entry is still checked for its targets.
WIDTHS = {"C4": 0.2189, "C7": 0.2526}


def script(name: str) -> ModuleType:
    return importlib.import_module(name)


def draw(figure: str, arguments: list[str]) -> Any:
    """The numbers of a figure."""
    return script("figures").main([figure, *arguments])[figure]


@pytest.fixture(autouse=True)
def examples_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(PAPER)


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """Figures by name, as the scripts save them; drawn coarsely."""
    paper = script("designs")
    monkeypatch.setattr(ngspring.view.design, "CELLS", 40)
    kept: dict[str, Figure] = {}
    write = paper.save_figure

    def keep(figure: Figure, path: Path) -> None:
        kept[path.stem] = figure
        write(figure, path, dpi=40)

    monkeypatch.setattr(paper, "save_figure", keep)
    return kept


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> dict[str, Design]:
    """A gallery of columns on 8 x 8 elements under all its names."""
    paper = script("designs")
    designs = {name: Design.column(on_mesh(run.problem, 8)[0]) for name, run in paper.RUNS.items()}
    monkeypatch.setattr(paper, "gallery", designs)
    return designs


def arguments(out: Path, *more: str) -> list[str]:
    return ["--out", str(out), "--threads", "1", *more]


def tidy(figure: Figure) -> bool:
    """Nothing is cut off, no title covers its neighbour, all states have aspect 1 and one scale."""
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height
    titles = [a.title.get_window_extent() for a in figure.axes if a.get_title()]
    apart = not any(a.overlaps(b) for i, a in enumerate(titles) for b in titles[:i])
    states = [a for a in figure.axes if a.get_aspect() == 1.0 and a.collections]
    return inside and apart and len({(a.get_xlim(), a.get_ylim()) for a in states}) <= 1


# -- the stored designs ----------------------------------------------------------------------------


def test_the_gallery_holds_every_spring_of_the_figures_and_c4_from_a_random_start() -> None:
    assert len(NAMES) == 26
    # No figure of the paper has C4 from a random start; it shows that C4 gets there too.
    assert sorted(gallery) == sorted(script("designs").RUNS) == sorted([*NAMES, "C4-random"])


@pytest.mark.parametrize("name", NAMES)
def test_stored_designs_meet_their_targets(name: str) -> None:
    design = gallery[name]
    ratio = design.equivalent_width / design.problem.H
    for q, point in zip(design.info["q"], design.problem.control_points, strict=True):
        assert point.eta or q == pytest.approx(point.q, rel=1e-3)
    assert design.history is not None
    assert ratio == pytest.approx(design.history.last().width, abs=1e-9)
    assert ratio == pytest.approx(WIDTHS.get(name, ratio), abs=1e-4)


def test_figs_4_and_5_of_the_stored_c4(
    tmp_path: Path, saved: dict[str, Figure], capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = draw("4", arguments(tmp_path, "--only", "C4", "--points", "2"))
    assert set(numbers) == {"C4"}
    assert numbers["C4"]["W/H"] == pytest.approx(0.2189, abs=1e-4)
    for place, target in (("q(10)", 2.0), ("q(-10)", -2.0), ("q(-20)", -4.0)):
        assert numbers["C4"][place] == pytest.approx(target, rel=1e-3)
    assert "not in the gallery: C1, C2, C3, C5, C6, C7" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fig04.png", "fig05.png"]
    titles = [axes.get_title() for axes in saved["fig05"].axes]
    assert titles[:4] == ["C1", "C2", "C3", "C4\nW/H = 0.2189"]
    assert titles[4:7] == [
        "d = 10 mm\nq = 2 N (target 2)",
        "d = -10 mm\nq = -2 N (target -2)",
        "d = -20 mm\nq = -4 N (target -4)",
    ]
    assert tidy(saved["fig05"])
    assert tidy(saved["fig04"])


def test_the_curves_of_stored_designs_are_not_computed_again(
    tmp_path: Path, saved: dict[str, Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ngspring.analysis.forward.load_displacement", None)
    numbers = draw("14", arguments(tmp_path))
    assert set(numbers) == set(FAMILIES["14"])
    for name, values in numbers.items():
        for point in gallery[name].problem.control_points:
            if not point.eta:
                assert values[f"q({point.d:g})"] == pytest.approx(point.q, rel=1e-3)
    assert tidy(saved["fig14"])


def test_load_paths_are_stored_beside_the_designs_and_only_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery, "folder", tmp_path)
    small = on_mesh(script("designs").RUNS["T1"].problem, 8)[0]
    Design.column(small).save(tmp_path / "T1.npz")
    main = script("states_of_gallery").main
    main([])
    first = (tmp_path / "states-T1.npz").stat().st_mtime_ns
    main(["T1"])
    assert (tmp_path / "states-T1.npz").stat().st_mtime_ns == first
    assert responses_in_gallery(gallery["T1"]) is not None
    assert list(gallery) == ["T1"]
    # Another design takes its place.
    Design.random(small).save(tmp_path / "T1.npz")
    assert responses_in_gallery(gallery["T1"]) is None
    main([])
    assert responses_in_gallery(gallery["T1"]) is not None


def test_fig_3(tmp_path: Path, saved: dict[str, Figure]) -> None:
    numbers = draw("3", arguments(tmp_path))["C4"]
    assert numbers["updates"] == 65
    assert numbers["newton iterations"] == 285
    assert numbers["last dt"] == np.inf
    assert numbers["last update with a smaller dt"] == 36
    assert numbers["W/H"] == pytest.approx(0.2189, abs=1e-4)
    assert numbers["largest growth of C"] < 1e-9
    assert numbers["misfit left after 17 updates"] < 2e-6
    assert numbers["misfit left after 20 updates"] < 1e-6
    assert tidy(saved["fig03"])


def test_fig_14_without_the_dilated_design_there_is_twice_as_much_grey() -> None:
    module = script("fig14_robust")
    grey = {name: module.grey_fraction(gallery[name]) for name in module.NAMES}
    expected = {"T1": 0.013, "T2": 0.015, "T1-not-robust": 0.032, "T2-not-robust": 0.030}
    assert grey == pytest.approx(expected, abs=1e-3)


def test_fig_16_of_the_stored_snapshots(tmp_path: Path, saved: dict[str, Figure]) -> None:
    ratios = draw("16", arguments(tmp_path))
    assert {name: len(designs) for name, designs in ratios.items()} == {"C7": 7, "C7-random": 7}
    for name, start, updates, end in (("C7", 0.5, 93, 0.2526), ("C7-random", 0.459, 102, 0.2513)):
        assert ratios[name][0] == pytest.approx(start, abs=1e-3)
        assert max(ratios[name]) == updates
        assert ratios[name][updates] == pytest.approx(end, abs=1e-4)
    assert tidy(saved["fig16"])


def test_the_overview_shows_every_stored_design(tmp_path: Path, saved: dict[str, Figure]) -> None:
    numbers = draw("gallery", arguments(tmp_path))
    assert set(numbers) == set(gallery)
    assert numbers["C7"]["W/H"] == pytest.approx(0.2526, abs=1e-4)
    titles = [axes.get_title().split("\n")[0] for axes in saved["gallery"].axes]
    assert [title for title in titles if title] == list(script("designs").RUNS)
    assert tidy(saved["gallery"])


# -- every script, with stand-ins ------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_families(
    name: str, tmp_path: Path, saved: dict[str, Figure], stand_ins: dict[str, Design]
) -> None:
    numbers = draw(name, arguments(tmp_path, "--points", "3"))
    assert set(numbers) == set(FAMILIES[name])
    for key, values in numbers.items():
        design = stand_ins[key]
        symbol = "D/H" if key.startswith("A") else "W/H"
        assert values[symbol] == pytest.approx(design.equivalent_width / 100)
        plain = [point for point in design.problem.control_points if not point.eta]
        forces = [values[f"q({point.d:g})"] for point in plain]
        assert [np.sign(q) for q in forces] == [np.sign(point.q) for point in plain]
    assert all(map(tidy, saved.values()))
    columns = 1 + len(plain)
    rows = saved[max(saved)].axes
    assert len(rows) == {"14": 10}.get(name, len(numbers) * (columns + 1))


def test_curves_cover_the_whole_range_with_41_points(
    stand_ins: dict[str, Design], monkeypatch: pytest.MonkeyPatch
) -> None:
    paper = script("designs")
    asked: list[float] = []

    def record(design: Design, places: list[float], threads: int | None) -> Response:
        asked.extend(places)
        return load_displacement(design, [0.0, 10.0], threads=1)

    monkeypatch.setattr(paper, "curve_of", record)
    options = paper.Options()
    curves, numbers = paper.compute_curves({"C1": stand_ins["C1"], "CT1": None}, options)
    assert set(curves) == set(numbers) == {"C1"}
    assert len(asked) >= 41
    assert (asked[0], asked[-1]) == (-20.0, 10.0)
    assert {0.0, -10.0} <= set(asked)
    assert np.diff(asked).max() <= 0.751
    assert np.isnan(numbers["C1"]["q(-20)"])


def test_a_missing_design_leaves_a_row_that_says_so(
    tmp_path: Path,
    saved: dict[str, Figure],
    stand_ins: dict[str, Design],
    capsys: pytest.CaptureFixture[str],
) -> None:
    del stand_ins["A4"], stand_ins["T1"], stand_ins["T2-not-robust"]
    more = arguments(tmp_path, "--points", "2")
    draw("11", more)
    assert "not in the gallery: A4\n" in capsys.readouterr().out
    empty = saved["fig11"].axes[-1]
    assert empty.get_title() == "A4"
    assert [text.get_text() for text in empty.texts] == ["not in\nthe gallery"]
    draw("14", more)
    assert "not in the gallery: T1, T2-not-robust\n" in capsys.readouterr().out
    assert tidy(saved["fig11"])
    assert tidy(saved["fig14"])


@pytest.mark.parametrize("name", [*FAMILIES, "3"])
def test_without_any_design_a_figure_fails(
    name: str, tmp_path: Path, stand_ins: dict[str, Design]
) -> None:
    stand_ins.clear()
    with pytest.raises(SystemExit, match=r"none of .* is in the gallery"):
        draw(name, arguments(tmp_path))
    assert not list(tmp_path.iterdir())


def test_bad_arguments_are_refused(tmp_path: Path) -> None:
    for more in (["--elements", "8"], ["--points", "1"], ["--only", "nonsense"]):
        with pytest.raises(SystemExit) as caught:
            draw("10", arguments(tmp_path, *more))
        assert caught.value.code == 2


@pytest.fixture
def one_update(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Run]:
    """The runs of the gallery, each stopped after one update; --recompute writes to tmp_path."""
    paper = script("designs")
    monkeypatch.chdir(tmp_path)
    runs = {name: dataclasses.replace(run, max_updates=1) for name, run in paper.RUNS.items()}
    monkeypatch.setattr(paper, "ALL_RUNS", runs)
    return runs


@pytest.mark.long
@pytest.mark.usefixtures("one_update")
def test_recompute_is_resumable_and_keeps_snapshots(
    tmp_path: Path, saved: dict[str, Figure]
) -> None:
    more = arguments(tmp_path, "--recompute", "--elements", "8", "--points", "2")
    first = draw("4", [*more, "--only", "C7"])
    again = draw("4", [*more, "--only", "C7"])
    assert first == again
    assert (tmp_path / "runs" / "figures" / "C7-8" / "design.npz").is_file()
    ratios = draw("16", more)
    assert set(ratios) == {"C7", "C7-random"}
    assert set(ratios["C7"]) == set(ratios["C7-random"]) == {0, 1}
    assert ratios["C7"][0] == pytest.approx(0.5)
    assert tidy(saved["fig16"])


def test_recompute_goes_the_way_of_the_gallery(one_update: dict[str, Run]) -> None:
    paper = script("designs")
    options = paper.Options(recompute=True, elements=8, threads=1)
    # C5 continues from C4, which is computed first; T1 begins from a file.
    after = paper.recompute("C5", options)
    before = Design.load("runs/figures/C4-8/design.npz")
    assert after.info["start"] == "run C4"
    assert before.info["start"] == "column"
    assert after.history is not None
    assert after.history["width"][0] == pytest.approx(before.equivalent_width / 100, abs=1e-9)
    t1 = paper.recompute("T1", options)
    assert t1.info["start"] == "design starts/T1-ellipse.npz"
    assert t1.history is not None
    ellipse = Design.load(one_update["T1"].design)
    assert t1.history["width"][0] == pytest.approx(ellipse.equivalent_width / 100, abs=0.02)


def test_the_start_of_t1_is_an_ellipse_with_a_neck(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(PAPER / "starts")
    ellipse = importlib.import_module("ellipse")
    run = script("designs").RUNS["T1"]
    start = Design.load(run.design)
    again = ellipse.ellipse(run.problem)
    assert np.array_equal(start.coefficients, again.coefficients)
    # Solid on the axis up to the middle of the spring; there the spline, which is level in y, puts
    # the neck's wall within 0.15 mm of the ellipse (chi has a slope of 8 per mm).
    assert start.density(50.0, 50.0) > 0.95
    assert abs(start.chi(50 - 18 * np.sqrt(1 - (50 / 51) ** 2), 50.0)) < 8 * 0.15
    assert abs(start.chi(32.0, 0.0)) < 8 * 0.02


# -- the two figures without stored designs --------------------------------------------------------


def test_fig_2(tmp_path: Path, saved: dict[str, Figure]) -> None:
    numbers = draw("2", arguments(tmp_path))["column"]
    assert numbers["lowest"] == pytest.approx(1 / (1 + np.exp(4.5)), abs=1e-3)
    assert numbers["highest"] == pytest.approx(1 / (1 + np.exp(-4.5)), abs=1e-3)
    assert numbers["centre"] == pytest.approx(1 / (1 + np.exp(-1.5)), abs=1e-3)
    assert numbers["W/H"] == pytest.approx(0.5, abs=1e-9)
    assert tidy(saved["fig02"])


def test_fig_15(tmp_path: Path, saved: dict[str, Figure]) -> None:
    numbers = draw("15", arguments(tmp_path))["E at eta"]
    # Eq. 3 with Eq. 2 and p = 8: E = 1 / (1 + 9 exp(-chi)), but for E_0 = 1e-6.
    expected = {-2.0: 0.014815, 0.0: 0.1, 2.0: 0.450853}
    assert numbers == pytest.approx(expected, abs=2e-6)
    assert len(saved["fig15"].axes) == 3
    assert tidy(saved["fig15"])


# -- post-evaluation -------------------------------------------------------------------------------


@pytest.mark.long
def test_fig_12(tmp_path: Path, saved: dict[str, Figure]) -> None:
    numbers = draw("12", arguments(tmp_path))
    assert list(numbers) == ["C1", "C4", "C7", "T2", "T3", "T6"]
    for quality in numbers.values():
        assert abs(quality["area error"]) < 1e-4
        assert quality["across"] >= 4
        assert quality["smallest angle"] > 20
    assert tidy(saved["fig12"])


@pytest.mark.long
def test_fig_13_of_the_stored_c4(tmp_path: Path, saved: dict[str, Figure]) -> None:
    more = arguments(tmp_path, "--only", "C4", "--points", "2", "--threads", "1")
    numbers = draw("13", more)["C4"]
    for place, target in (("q(10)", 2.0), ("q(-10)", -2.0), ("q(-20)", -4.0)):
        # The solid up to chi = 0 is some percent stiffer than the grey surface of the third medium.
        assert 1.03 < numbers[place] / target < 1.09
    assert 0.03 < numbers["largest deviation"] < 0.09
    assert tidy(saved["fig13"])
    assert [axes.get_title() for axes in saved["fig13"].axes] == ["compression"]


@pytest.mark.long
def test_more_material_makes_c4_stiffer(
    tmp_path: Path, saved: dict[str, Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = script("tolerance_c7")
    # Two elements across a wall are enough for the signs.
    short = functools.partial(module.tolerance, offsets=(0.25,), elements_across=2)
    monkeypatch.setattr(module, "tolerance", short)
    more = arguments(tmp_path, "--only", "C4", "--points", "2", "--threads", "1")
    slopes = draw("tolerance", more)["C4"]
    assert slopes["dq/d(offset) at 10"] > 0
    assert slopes["dq/d(offset) at -10"] < 0
    assert slopes["dq/d(offset) at -20"] < 0
    assert tidy(saved["tolerance-C4"])


def test_the_tables_of_the_results_page_are_those_of_the_stored_designs() -> None:
    module = script("results_page")
    assert module.page() == module.PAGE.read_text(encoding="utf-8")


@pytest.mark.long
def test_stored_verdicts_belong_to_the_stored_designs() -> None:
    stored = script("gallery_results")
    for module, results, designs in (
        (script("stability_of_gallery"), "stability", gallery),
        (script("verification_of_gallery"), "verification", gallery),
        (script("evaluation_of_parts"), "parts", parts),
    ):
        for name, found in stored.read(results).items():
            assert found["design"] == stored.fingerprint(designs[name])
        # Nothing is left to compute for designs that are known already.
        known = list(stored.read(results))
        assert not known or module.main(known) == stored.read(results)


def test_stored_deviations_are_positive_where_the_solid_is_stronger() -> None:
    for found in script("gallery_results").read("verification").values():
        for point in found.get("control_points", ()):
            stronger = abs(point["q_contact"]) - abs(point["q_third_medium"])
            assert point["deviation"] == pytest.approx(stronger)


def test_what_others_have_evaluated_meanwhile_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = script("gallery_results")
    monkeypatch.setattr(module, "HERE", tmp_path)
    path = tmp_path / "results" / "numbers.json"
    path.parent.mkdir()

    def evaluation(name: str, design: Design, threads: int | None) -> dict[str, object]:
        path.write_text('{"other": {"design": "x"}}')
        return {"value": name}

    column = Design.column(ngspring.cases["C4"].replace(elements=8, l_i=10.0))
    known = module.evaluate("numbers", None, evaluation, [], {"mine": column})
    assert known["other"] == {"design": "x"}
    assert known["mine"]["value"] == "mine"
