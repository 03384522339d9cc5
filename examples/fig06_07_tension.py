"""Figs. 6 and 7: tension springs T1-T6, from softening to stiffening (Table 3).

Fig. 6: their load-displacement curves through the targets. Fig. 7: each design undeformed, at
d = 10 and 20 mm, and its curve. T1 and T2, on a finer mesh and with the robust formulation,
soften by a narrow neck (T1's is 6.6 mm wide with a line of density 0.82 across it, the paper's
about 4 mm); in T3-T6 curved members straighten, in T4-T6 they also touch.

Numbers to expect: q(10) = 2 N and q(20) = 3, 3.5, ..., 5.5 N within 0.1 %; W/H grows from T2 to T6,
and T1 is large.
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import Numbers, compute_curves, load_designs, read_options, save

from ngspring.view.design import curves_figure
from ngspring.view.rows import gallery_figure

NAMES = ("T1", "T2", "T3", "T4", "T5", "T6")


def main(arguments: Sequence[str] | None = None) -> Numbers:
    options = read_options(__doc__, arguments)
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    save(curves_figure(designs, curves), options, "fig06")
    save(gallery_figure(designs, curves), options, "fig07")
    return numbers


if __name__ == "__main__":
    main()
