"""What the figures of this folder share: their options, their designs, their curves.

What the designs are is said in gallery.toml.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ngspring import Design, gallery, optimize
from ngspring.analysis.finished import curve_of
from ngspring.analysis.states import States, curve_displacements, index_of
from ngspring.campaign.plan import read_campaign
from ngspring.cli.progress import shown_progress
from ngspring.cli.tables import make_console
from ngspring.evolution.folder import read_design
from ngspring.evolution.ladder import NO_LADDER
from ngspring.problem.scaling import on_mesh
from ngspring.view.figure import save_figure
from ngspring.view.text import width_symbol

HERE = Path(__file__).parent
ALL_RUNS = {run.name: run for run in read_campaign(HERE / "gallery.toml").runs}
#: Without those that are only starts for others.
RUNS = {name: run for name, run in ALL_RUNS.items() if not name.endswith("-coarse")}
#: What a figure says in numbers: by design (or the like) and quantity.
Numbers = dict[str, dict[Any, float]]


@dataclass(frozen=True)
class Options:
    """How figures are drawn, see ``python examples/paper/figures.py --help``."""

    out: Path = HERE / "figures"
    points: int = 41
    only: tuple[str, ...] | None = None
    recompute: bool = False
    elements: int | None = None
    threads: int | None = None

    def folder(self, name: str) -> Path:
        """Run folder of a design that is optimised anew."""
        suffix = "" if self.elements is None else f"-{self.elements}"
        return Path("runs", "figures", name + suffix)


def load_designs(names: Iterable[str], options: Options) -> dict[str, Design | None]:
    """Designs by name, None where the gallery has none; says which, and exits if none is there."""
    designs: dict[str, Design | None] = {}
    for name in names:
        wanted = options.only is None or name in options.only
        if wanted and options.recompute:
            designs[name] = recompute(name, options)
        else:
            designs[name] = gallery.get(name) if wanted else None
    missing = ", ".join(name for name, design in designs.items() if design is None)
    if not any(designs.values()):
        raise SystemExit(f"none of {missing} is in the gallery: use --recompute")
    if missing:
        print(f"not in the gallery: {missing}")
    return designs


def recompute(name: str, options: Options) -> Design:
    """Optimise a design of gallery.toml."""
    run, folder = ALL_RUNS[name], options.folder(name)
    problem = run.problem
    if options.elements is not None:
        problem, note = on_mesh(problem, options.elements)
        print(f"{name}: {note}")
    initial = None
    if run.after is not None:
        initial = recompute(run.after, options)
    elif run.design is not None:
        initial = read_design(run.design)[0]
    elif run.start == "random":
        initial = Design.random(problem, run.seed or 0)
    with shown_progress(problem, make_console()) as progress:
        result = optimize(
            problem,
            initial,
            run.dt_initial,
            run.max_updates,
            folder,
            (progress,),
            resume=True,
            threads=options.threads,
            start_name=run.start_name,
            ladder=None if run.ladder else NO_LADDER,
        )
    if not result.converged:
        print(f"{name}: not converged: {result.message}")
    return result.design


def compute_curves(
    designs: Mapping[str, Design | None], options: Options
) -> tuple[dict[str, States], Numbers]:
    """Curves over the whole range of each case, and W/H (or D/H) and forces in N by name."""
    curves: dict[str, States] = {}
    numbers: Numbers = {}
    for name, design in designs.items():
        if design is None:
            continue
        points = [point for point in design.problem.control_points if not point.eta]
        places = {0.0, *curve_displacements(design, points=options.points), *(p.d for p in points)}
        curves[name] = curve = curve_of(design, sorted(places), threads=options.threads)
        symbol = width_symbol(design.problem)
        numbers[name] = {symbol: design.relative_width}
        for point in points:
            k = index_of(curve, point.d)
            numbers[name][f"q({point.d:g})"] = float("nan") if k is None else float(curve.q[k])
        if not curve.complete:
            print(f"{name}: {curve.message}")
    return curves, numbers


def save(figure: Figure, options: Options, name: str) -> None:
    path = options.out / f"{name}.png"
    save_figure(figure, path)
    print(path)
