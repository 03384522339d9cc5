"""The paper's figures, drawn from the stored designs, and a few pictures more.

    python examples/paper/figures.py 4 5 --out DIR

From the stored designs a figure takes seconds, with real contact minutes. Figures that share their
curves are drawn together. A design that is not stored leaves its row empty; without any, it is an
error.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import c_shape
import fig02_initial_design
import fig03_convergence_c4
import fig12_meshes
import fig13_post_evaluation
import fig14_robust
import fig15_erosion_dilation
import fig16_snapshots_c7
import gallery_overview
import tolerance_c7
from designs import RUNS, Numbers, Options, compute_curves, load_designs, save

from ngspring.view.curves import curves_figure
from ngspring.view.rows import gallery_figure


@dataclass(frozen=True)
class Figure:
    """What there is to see and which numbers to expect, and what draws it."""

    text: str
    draw: Callable[[Options], Numbers]


@dataclass(frozen=True)
class Family:
    """Springs side by side: `rows` shows each with its states, `curves` all in one diagram."""

    designs: tuple[str, ...]
    rows: str
    curves: str | None = None

    def draw(self, options: Options) -> Numbers:
        designs = load_designs(self.designs, options)
        curves, numbers = compute_curves(designs, options)
        if self.curves is not None:
            save(curves_figure(designs, curves), options, self.curves)
        save(gallery_figure(designs, curves), options, self.rows)
        return numbers


COMPRESSION = Figure(
    """Figs. 4 and 5: compression springs C1-C7, from softening to stiffening (Table 2).

Fig. 4: their load-displacement curves through the targets. Fig. 5: each design undeformed, at
d = 10, -10 and -20 mm, and its curve. All are a single column with a hole at its centre; its walls
buckle outwards (softer) and touch (stiffer), and W/H grows from C1 to C7.

Numbers to expect: q(10) = 2 N, q(-10) = -2 N and q(-20) = -2.5, -3, ..., -5.5 N within 0.1 %;
W/H = 0.2189 (C4) and 0.2526 (C7; the paper reaches 0.2539 from its own start).
""",
    Family(("C1", "C2", "C3", "C4", "C5", "C6", "C7"), rows="fig05", curves="fig04").draw,
)
TENSION = Figure(
    """Figs. 6 and 7: tension springs T1-T6, from softening to stiffening (Table 3).

Fig. 6: their load-displacement curves through the targets. Fig. 7: each design undeformed, at
d = 10 and 20 mm, and its curve. T1 and T2, on a finer mesh and with the robust formulation,
soften by a narrow neck (T1's is 6.6 mm wide with a line of density 0.82 across it, the paper's
about 4 mm); in T3-T6 curved members straighten, in T4-T6 they also touch.

Numbers to expect: q(10) = 2 N and q(20) = 3, 3.5, ..., 5.5 N within 0.1 %; W/H grows from T2 to T6,
and T1 is large.
""",
    Family(("T1", "T2", "T3", "T4", "T5", "T6"), rows="fig07", curves="fig06").draw,
)
LINEAR_IN_TENSION = Figure(
    """Fig. 8: springs CT1-CT3, linear in tension and softening, linear, stiffening in compression.

Each design undeformed, at d = 10, 20, -10 and -20 mm, and its load-displacement curve (Table 4).

Numbers to expect: q = 2, 4 and -2 N at d = 10, 20 and -10 mm, and q(-20) = -3.2, -4 and -4.8 N,
all within 0.1 %.
""",
    Family(("CT1", "CT2", "CT3"), rows="fig08").draw,
)
STIFFENING_IN_TENSION = Figure(
    """Fig. 9: springs CT4-CT6, stiffening in tension and softening to stiffening in compression.

Each design undeformed, at d = 10, 20, -10 and -20 mm, and its load-displacement curve (Table 4).

Numbers to expect: q = 2, 4.8 and -2 N at d = 10, 20 and -10 mm, and q(-20) = -3.2, -4 and -4.8 N,
all within 0.1 %.
""",
    Family(("CT4", "CT5", "CT6"), rows="fig09").draw,
)
AXISYMMETRIC_SOFTENING = Figure(
    """Fig. 10: axisymmetric springs A1 and A2, softening in compression.

Cross-sections undeformed, at d = 10, -10 and -20 mm, and the load-displacement curves. The paper
gives the targets of this figure only as a picture; ours have the ratios of C1 and C3 (Table 2).
In the paper both are hollow tubes.

Numbers to expect: q = 100 and -100 N at d = 10 and -10 mm, and q(-20) = -125 and -175 N, all within
0.1 %.
""",
    Family(("A1", "A2"), rows="fig10").draw,
)
AXISYMMETRIC_STIFFENING = Figure(
    """Fig. 11: axisymmetric springs A3 and A4, stiffening in compression.

Cross-sections undeformed, at d = 10, -10 and -20 mm, and the load-displacement curves. The paper
gives the targets of this figure only as a picture; ours have the ratios of C5 and C7 (Table 2).
In the paper the first is a hollow tube, the second a column with a hole.

Numbers to expect: q = 100 and -100 N at d = 10 and -10 mm, and q(-20) = -225 and -275 N, all within
0.1 %.
""",
    Family(("A3", "A4"), rows="fig11").draw,
)


def of_module(module: ModuleType) -> Figure:
    """A figure that is unlike all others has a module, with its text and a function `draw`."""
    return Figure(module.__doc__ or "", module.draw)


#: By the number in the paper; the last three are not in it.
FIGURES = {
    "2": of_module(fig02_initial_design),
    "3": of_module(fig03_convergence_c4),
    "4": COMPRESSION,
    "5": COMPRESSION,
    "6": TENSION,
    "7": TENSION,
    "8": LINEAR_IN_TENSION,
    "9": STIFFENING_IN_TENSION,
    "10": AXISYMMETRIC_SOFTENING,
    "11": AXISYMMETRIC_STIFFENING,
    "12": of_module(fig12_meshes),
    "13": of_module(fig13_post_evaluation),
    "14": of_module(fig14_robust),
    "15": of_module(fig15_erosion_dilation),
    "16": of_module(fig16_snapshots_c7),
    "gallery": of_module(gallery_overview),
    "c-shape": of_module(c_shape),
    "tolerance": of_module(tolerance_c7),
}


def table_of_figures() -> str:
    """Names and first lines, for --help."""
    lines = ["figures:"]
    for figure in dict.fromkeys(FIGURES.values()):
        names = ", ".join(name for name, other in FIGURES.items() if other is figure)
        lines.append(f"  {names:11}{figure.text.splitlines()[0]}")
    return "\n".join(lines)


def read_arguments(arguments: Sequence[str] | None) -> tuple[list[str], Options]:
    """Names of the figures asked for, and how to draw them."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog=table_of_figures(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    default = Options()
    parser.add_argument("figures", nargs="+", metavar="FIGURE", choices=FIGURES, help="see below")
    parser.add_argument("--out", type=Path, default=default.out, help="folder for pictures")
    parser.add_argument("--points", type=int, default=default.points, help="points of each curve")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=RUNS, help="only these")
    parser.add_argument(
        "--recompute",
        action="store_true",
        help="optimise the designs anew, in runs/figures (resumable): minutes to hours each",
    )
    parser.add_argument("--elements", type=int, help="coarser mesh for --recompute")
    parser.add_argument("--threads", type=int, help="threads to use")
    given = parser.parse_args(arguments)
    if given.elements is not None and not given.recompute:
        parser.error("--elements belongs to --recompute")
    if given.points < 2:
        parser.error("--points must be at least 2")
    only = None if given.only is None else tuple(given.only)
    given.out.mkdir(parents=True, exist_ok=True)
    return given.figures, Options(
        given.out, given.points, only, given.recompute, given.elements, given.threads
    )


def main(arguments: Sequence[str] | None = None) -> dict[str, Numbers]:
    """Draw figures; returns the numbers of each by its name."""
    names, options = read_arguments(arguments)
    drawn: dict[Figure, Numbers] = {}
    for figure in dict.fromkeys(FIGURES[name] for name in names):
        print(figure.text)
        drawn[figure] = numbers = figure.draw(options)
        for name, values in numbers.items():
            print(f"{name}: {', '.join(f'{key} = {value:.5g}' for key, value in values.items())}")
    return {name: drawn[FIGURES[name]] for name in names}


if __name__ == "__main__":
    main()
