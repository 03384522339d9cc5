"""Fig. 2: density of the design that the optimisations start with, and its two symmetry axes.

The paper shows its start only as a picture; ours is a column with a thinner, softer middle,
chi = 3 cos(2 pi X/L) (1 - cos(2 pi Y/H) / 2) with X, Y from the centre (`ngspring.Design.column`).

Numbers to expect: rho from 0.011 (left and right of the column's ends) to 0.989 at its ends,
0.818 in the centre, and W/H = 0.5 by symmetry.
"""

from __future__ import annotations

import numpy as np
from designs import Numbers, Options, save

from ngspring import Design, cases
from ngspring.view.design import density_figure


def draw(options: Options) -> Numbers:
    design = Design.column(cases["C4"])
    save(density_figure(design), options, "fig02")
    x = np.linspace(0, 100, 201)
    rho = design.density(x[:, None], x[None, :])
    numbers = {
        "lowest": float(rho.min()),
        "highest": float(rho.max()),
        "centre": float(rho[100, 100]),
        "W/H": design.equivalent_width / 100,
    }
    return {"column": numbers}
