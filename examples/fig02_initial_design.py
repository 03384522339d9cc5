"""Fig. 2: density of the design that the optimisations start with, and its two symmetry axes.

The paper shows its start only as a picture; ours is a column with a thinner, softer middle,
chi = 3 cos(2 pi X/L) (1 - cos(2 pi Y/H) / 2) with X, Y from the centre (`ngspring.Design.column`).

Numbers to expect: rho from 0.011 (left and right of the column's ends) to 0.989 at its ends,
0.818 in the centre, and W/H = 0.5 by symmetry.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from figures import read_options, save

from ngspring import Design, cases
from ngspring.view.design import density_figure


def main(arguments: Sequence[str] | None = None) -> dict[str, float]:
    options = read_options(__doc__, arguments)
    design = Design.column(cases["C4"])
    save(density_figure(design), options, "fig02")
    x = np.linspace(0, 100, 201)
    rho = design.density(x[:, None], x[None, :])
    return {
        "lowest": float(rho.min()),
        "highest": float(rho.max()),
        "centre": float(rho[100, 100]),
        "W/H": design.equivalent_width / 100,
    }


if __name__ == "__main__":
    print(main())
