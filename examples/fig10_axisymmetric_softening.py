"""Fig. 10: axisymmetric springs A1 and A2, softening in compression.

Cross-sections undeformed, at d = 10, -10 and -20 mm, and the load-displacement curves. The paper
gives the targets of this figure only as a picture; ours have the ratios of C1 and C3 (Table 2).
In the paper both are hollow tubes.

Numbers to expect: q = 100 and -100 N at d = 10 and -10 mm, and q(-20) = -125 and -175 N, all within
0.1 %.
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import Numbers, compute_curves, load_designs, read_options, save

from ngspring.view.rows import gallery_figure

NAMES = ("A1", "A2")


def main(arguments: Sequence[str] | None = None) -> Numbers:
    options = read_options(__doc__, arguments)
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    save(gallery_figure(designs, curves), options, "fig10")
    return numbers


if __name__ == "__main__":
    main()
