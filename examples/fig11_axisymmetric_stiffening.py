"""Fig. 11: axisymmetric springs A3 and A4, stiffening in compression.

Cross-sections undeformed, at d = 10, -10 and -20 mm, and the load-displacement curves. The paper
gives the targets of this figure only as a picture; ours have the ratios of C5 and C7 (Table 2).
In the paper the first is a hollow tube, the second a column with a hole.

Numbers to expect: q = 100 and -100 N at d = 10 and -10 mm, and q(-20) = -225 and -275 N, all within
0.1 %.
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import Numbers, compute_curves, load_designs, read_options, save

from ngspring.view.rows import gallery_figure

NAMES = ("A3", "A4")


def main(arguments: Sequence[str] | None = None) -> Numbers:
    options = read_options(__doc__, arguments)
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    save(gallery_figure(designs, curves), options, "fig11")
    return numbers


if __name__ == "__main__":
    main()
