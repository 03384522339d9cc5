"""Fig. 8: springs CT1-CT3, linear in tension and softening, linear, stiffening in compression.

Each design undeformed, at d = 10, 20, -10 and -20 mm, and its load-displacement curve (Table 4).

Numbers to expect: q = 2, 4 and -2 N at d = 10, 20 and -10 mm, and q(-20) = -3.2, -4 and -4.8 N,
all within 0.1 %.
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import Numbers, compute_curves, load_designs, read_options, save

from ngspring.view.rows import gallery_figure

NAMES = ("CT1", "CT2", "CT3")


def main(arguments: Sequence[str] | None = None) -> Numbers:
    options = read_options(__doc__, arguments)
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    save(gallery_figure(designs, curves), options, "fig08")
    return numbers


if __name__ == "__main__":
    main()
