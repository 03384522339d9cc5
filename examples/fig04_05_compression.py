"""Figs. 4 and 5: compression springs C1-C7, from softening to stiffening (Table 2).

Fig. 4: their load-displacement curves through the targets. Fig. 5: each design undeformed, at
d = 10, -10 and -20 mm, and its curve. All are a single column with a hole at its centre; its walls
buckle outwards (softer) and touch (stiffer), and W/H grows from C1 to C7.

Numbers to expect: q(10) = 2 N, q(-10) = -2 N and q(-20) = -2.5, -3, ..., -5.5 N within 0.1 %;
W/H = 0.2189 (C4) and 0.2526 (C7; the paper reaches 0.2539 from its own start).
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import Numbers, compute_curves, load_designs, read_options, save

from ngspring.view.design import curves_figure
from ngspring.view.rows import gallery_figure

NAMES = ("C1", "C2", "C3", "C4", "C5", "C6", "C7")


def main(arguments: Sequence[str] | None = None) -> Numbers:
    options = read_options(__doc__, arguments)
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    save(curves_figure(designs, curves), options, "fig04")
    save(gallery_figure(designs, curves), options, "fig05")
    return numbers


if __name__ == "__main__":
    main()
