"""From a measured curve to a spring: a CSV file in, a design and its picture out.

    python examples/from_a_measured_curve.py

Half a minute; writes the design (.npz) and the picture (.png) of that name.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import ngspring

CURVE = Path(__file__).with_name("measured_curve.csv")
L, H, T = 40.0, 40.0, 20.0  # width, height and thickness in mm


def main(elements: int = 16, out: Path = Path()) -> ngspring.Result:
    curve = ngspring.read_curve(CURVE, height=H, area=L * T)
    size = {"L": L, "H": H, "T": T, "elements": elements, "l_i": 0.8 * H / elements}
    problem = ngspring.problem_from_curve(curve, at=[-8, -4, 4], shore_A=50, **size)
    for finding in ngspring.check_targets(problem):
        print(f"{finding.level}: {finding.message}")
    result = ngspring.optimize(problem)
    result.design.save(out / "from_a_measured_curve.npz")  # ngspring verify, export, ...
    response = ngspring.load_displacement(result.design, curve.d)
    figure, axes = plt.subplots()
    axes.plot(curve.d, curve.q, ".", color="0.6", label="measured")
    axes.plot(response.d, response.q, "k", label="spring")
    axes.plot([p.d for p in problem.control_points], result.q, "ko", label="control points")
    axes.set(xlabel="d [mm]", ylabel="q [N]")
    axes.legend()
    figure.savefig(out / "from_a_measured_curve.png")
    return result


if __name__ == "__main__":
    print(main().q)
