"""My own spring: points of its load-displacement curve in, a spring and its picture out.

    python examples/my_own_spring.py

Half a minute; writes my_own_spring.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import ngspring
from ngspring import ControlPoint, SpringProblem

TARGETS = [ControlPoint(d=10, q=2), ControlPoint(d=-10, q=-2), ControlPoint(d=-20, q=-3)]  # mm, N


def main(elements: int = 16, picture: str = "my_own_spring.png") -> ngspring.Result:
    # The interface between solid and void is 4/5 of an element wide; the rest is as in the paper.
    problem = SpringProblem(TARGETS, elements=elements, l_i=80 / elements)
    result = ngspring.optimize(problem)
    curve = ngspring.load_displacement(result.design, range(-20, 11))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4))
    x = np.linspace(0, 100, 201)
    rho = result.design.density(x[:, None], x[None, :])
    left.imshow(rho.T, cmap="gray_r", origin="lower", extent=(0, 100, 0, 100))
    left.set(title="density", xlabel="x [mm]", ylabel="y [mm]")
    right.plot(curve.d, curve.q, "k", label="response")
    right.plot([p.d for p in TARGETS], [p.q for p in TARGETS], "ko", mfc="none", label="targets")
    right.set(xlabel="d [mm]", ylabel="q [N]")
    right.legend()
    figure.savefig(picture)
    return result


if __name__ == "__main__":
    print(main().q)
