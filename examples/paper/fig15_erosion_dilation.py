"""Fig. 15: what an offset of chi does to the stiffness, in one dimension (Appendix A).

From above: a made-up level-set field chi(x) with a solid, a void and an intermediate region
(chi = 0 between x = 50 and 70 mm); its density rho (Eq. 2); and the stiffness factor E of chi + eta
(Eq. 3, p = 8) for the eroded (eta = -2), the blueprint and the dilated design (eta = 2).

Numbers to expect: in the intermediate region rho = 0.5 and E = 0.0148, 0.1 and 0.451 for
eta = -2, 0 and 2: dilation makes it 4.5 times as stiff, while in the solid (chi = 10) nothing
changes (E = 0.997, 0.9996, 0.9999).
"""

from __future__ import annotations

import numpy as np
from designs import Numbers, Options, save

from ngspring import cases
from ngspring.physics.chi import stiffness
from ngspring.view.design import offsets_figure

OFFSETS = (-2.0, 0.0, 2.0)
# Slopes of 8 / l_i, with an interface of l_i = 8 mm so that it can be seen.
X = (0, 5, 25, 45, 50, 70, 80, 100)
CHI = (-10, -10, 10, 5, 0, 0, -10, -10)


def draw(options: Options) -> Numbers:
    x = np.linspace(0, 100, 1001)
    # A running mean rounds the corners of the polygon.
    chi = np.mean([np.interp(x + shift, X, CHI) for shift in np.linspace(-3, 3, 61)], axis=0)
    save(offsets_figure(x, chi, cases["T1"], OFFSETS), options, "fig15")
    middle = np.array([chi[600]])
    return {"E at eta": {e: float(stiffness(middle + e, cases["T1"])[0]) for e in OFFSETS}}
