"""The start of T1 in ../gallery.toml: a solid ellipse, cut by the sides where its tips would be.

Semi-axes of 18 and 51 mm, twice the height of the quarter and a little more: at the loaded side a
neck is left. chi falls by 8/l_i per mm at the sides of the ellipse, as on an established interface
(2.6), and has a parabola inside. Run by hand, it writes T1-ellipse.npz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ngspring import Design, SpringProblem, cases
from ngspring.splines import FloatArray

FILE = Path(__file__).with_name("T1-ellipse.npz")


def ellipse(problem: SpringProblem, a: float = 18.0, b: float = 51.0) -> Design:
    """A design that is solid inside an ellipse around the middle of the lower side.

    Parameters
    ----------
    problem : SpringProblem
    a, b : float
        Semi-axes in x and y in mm.
    """

    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        g = np.hypot((x - problem.L / 2) / a, y / b)
        return 4 * a / problem.l_i * np.where(g < 1, 1 - g**2, 2 * (1 - g))

    return Design.from_function(problem, chi)


if __name__ == "__main__":
    ellipse(cases["T1"]).save(FILE)
