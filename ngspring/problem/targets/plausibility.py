"""Can this target be met at all? What can be said before an hour is spent.

Everything here is arithmetic on the problem: signs and monotonicity of the target, the full solid
block as an upper bound (`ngspring.problem.targets.full_block`), the thinnest straight strut that
the mesh resolves as a mark of softness, the weight of the volume against that of the targets, and
hints at mistaken units.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ngspring.problem.laws.stability import first_limit
from ngspring.problem.material import nu_advice, young_and_poisson
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import with_similar_weights
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.full_block import block_force, block_stress

LEVELS = ("error", "warning", "note")

#: Share of the full block's force above which little room is left for a spring's shape.
NEARLY_FULL = 0.5
#: Relative displacement above which nothing like it has been tried.
EXTREME_STRETCH = 0.5
#: Relative displacement below which a spring is practically linear.
SMALL_STRETCH = 1e-3
#: Principal stretch that walls of a spring reach here and there.
SOON_STRETCHED = 2.0
#: Exponents of a power law through zero and two targets, as tried in the paper (Tables 2 and 3).
TRIED_COMPRESSION = (0.32, 1.46)
TRIED_TENSION = (0.58, 1.46)
#: Shift of the forces by the volume term: visible, and so small that the volume hardly counts.
VISIBLE_SHIFT, NEGLIGIBLE_SHIFT = 1e-2, 1e-10


@dataclass(frozen=True)
class Finding:
    """One thing to know about a target.

    Attributes
    ----------
    level : {"error", "warning", "note"}
        An error is a target that cannot be met.
    message : str
        One line.
    """

    level: str
    message: str


def check_targets(problem: SpringProblem) -> list[Finding]:
    """Everything that can be said about a problem without solving it, errors first.

    Parameters
    ----------
    problem : SpringProblem

    Returns
    -------
    list of Finding
        Empty if there is nothing to say. A mistaken unit of the displacements comes before
        everything that follows from it.
    """
    findings: list[Finding] = []
    for check in (
        _signs,
        _monotone,
        _block,
        _soft,
        _volume,
        _stretch,
        _law,
        _shape,
        _sides,
        _numerics,
    ):
        findings += check(problem)
    findings.sort(key=lambda finding: LEVELS.index(finding.level))
    if _may_be_in_metres(problem):
        # Whatever else is wrong comes from the unit, and so do all other suggestions.
        level = "error" if findings and findings[0].level == "error" else "warning"
        findings.insert(
            0, Finding(level, _too_small(problem, "; was it in m? (times 1000 it fits)"))
        )
    return findings


def _blueprint(problem: SpringProblem) -> tuple[ControlPoint, ...]:
    """Control points of the design itself, in order of d; all of them if every one has an eta."""
    points = [p for p in problem.control_points if p.own] or problem.control_points
    return tuple(sorted(points, key=lambda p: p.d))


def _at(points: Sequence[ControlPoint]) -> str:
    places = ", ".join(f"{p.d:g}" for p in points)
    return f"d = {places} mm"


def _signs(problem: SpringProblem) -> Iterator[Finding]:
    points = _blueprint(problem)
    against = [p for p in points if p.q * p.d < 0.0]
    if against and len(against) == len(points):
        yield Finding(
            "error",
            "every force has the sign opposite to its displacement: here tension is positive for"
            " both d and q, so compression has d < 0 and q < 0; change the sign of one column",
        )
    elif against:
        yield Finding(
            "warning",
            f"q at {_at(against)} has the sign opposite to d: such a spring pushes while it is"
            " stretched (or pulls while it is compressed), so it is bistable and has snapped"
            " through before. If that is not what you want, change the sign",
        )
    idle = [p for p in points if p.q == 0.0]
    if idle:
        yield Finding(
            "warning",
            f"q = 0 at {_at(idle)}: no connected spring is free of force there; the closest is as"
            " thin as the mesh resolves. A small force is a better target",
        )


def _monotone(problem: SpringProblem) -> Iterator[Finding]:
    pairs = [(0.0, 0.0), *((p.d, p.q) for p in _blueprint(problem))]
    pairs.sort()
    for (d_1, q_1), (d_2, q_2) in pairwise(pairs):
        if q_2 < q_1 and q_1 * d_1 >= 0.0 and q_2 * d_2 >= 0.0:
            # Told on the way from rest.
            first, last = sorted([(d_1, q_1), (d_2, q_2)], key=lambda point: abs(point[0]))
            yield Finding(
                "warning",
                f"the force falls from {first[1]:g} to {last[1]:g} N between d = {first[0]:g} and"
                f" {last[0]:g} mm:"
                " negative stiffness, so under a given force the spring will snap through there."
                " Under a given displacement, as here, such a curve is possible, but the path to"
                " the control points may jump and convergence is harder",
            )


def _thousand(problem: SpringProblem, point: ControlPoint) -> str:
    """Hint at a mistaken unit of the force, from its ratio to the full block's."""
    if abs(point.d) < SMALL_STRETCH * problem.H:
        return ""
    ratio = abs(point.q / block_force(problem, point.d))
    if 0.03 <= ratio / 1e3 <= NEARLY_FULL:
        return " (divided by 1000 it would fit: was it in mN?)"
    if ratio <= 1e-3 and 0.03 <= ratio * 1e3 <= NEARLY_FULL:
        return " (times 1000 it would fit: was it in kN?)"
    return ""


def _block(problem: SpringProblem) -> Iterator[Finding]:
    over: list[tuple[float, ControlPoint, float]] = []
    heavy: list[tuple[float, ControlPoint, float]] = []
    for point in _blueprint(problem):
        bound = block_force(problem, point.d)
        ratio = point.q / bound
        if ratio > 1.0:
            over.append((ratio, point, bound))
        elif ratio > NEARLY_FULL:
            heavy.append((ratio, point, bound))
    if over:
        ratio, point, bound = max(over, key=lambda item: item[0])
        yield Finding(
            "error",
            f"q = {point.q:g} N at d = {point.d:g} mm is out of reach: a full solid block of"
            f" {problem.L:g} x {problem.H:g} mm of this material carries {bound:.4g} N there"
            f"{_thousand(problem, point)}. Take a stiffer material (at least {ratio:.3g} times), "
            f"{problem.motion.larger}, or less force",
        )
    if heavy:
        ratio, point, bound = max(heavy, key=lambda item: item[0])
        yield Finding(
            "warning",
            f"q = {point.q:g} N at d = {point.d:g} mm is {100 * ratio:.0f} % of what a full solid"
            f" block carries ({bound:.4g} N): nearly everything will be solid, with little room"
            " for a shape (the paper's springs need 8 to 30 %)",
        )


def strut_forces(problem: SpringProblem, d: float) -> tuple[float, float]:
    """Forces in N of the thinnest straight strut from top to bottom that the mesh resolves.

    Its width is 2 l_i, or two elements if these are wider; in the axisymmetric case this is the
    diameter of a rod on the axis.

    Parameters
    ----------
    problem : SpringProblem
    d : float
        Displacement in mm.

    Returns
    -------
    straight, buckling : float
        Size of its force at d as long as it is straight, and Euler's load with clamped ends.
    """
    width = 2 * max(problem.l_i, problem.h_x)
    stress = block_stress(problem, d)
    E, nu = young_and_poisson(problem.K, problem.G)
    area = problem.motion.top_area(width, problem.T)
    bending = problem.motion.bending_stiffness(width, problem.T, E, nu)
    return abs(stress) * area, 4 * math.pi**2 * bending / problem.H**2


def _soft(problem: SpringProblem) -> Iterator[Finding]:
    softer: list[tuple[float, ControlPoint, float]] = []
    for point in _blueprint(problem):
        straight, buckling = strut_forces(problem, point.d)
        least = straight if point.d > 0.0 else min(straight, buckling)
        if 0.0 < abs(point.q) < least and point.q * point.d > 0.0:
            softer.append((abs(point.q) / least, point, least))
    if softer:
        _, point, least = min(softer, key=lambda item: item[0])
        hint = _thousand(problem, point)
        yield Finding(
            "warning",
            f"q = {point.q:g} N at d = {point.d:g} mm is softer than the thinnest straight strut"
            f" that the mesh resolves ({least:.3g} N){hint}. Only curved members that bend can do"
            " that: expect a design at the limit of resolution, or none that is connected. Take"
            " more elements with a smaller l_i, or a softer material"
            f"{', or a smaller T' if problem.motion.thick else ''}",
        )


def volume_shift(problem: SpringProblem) -> float:
    """Estimate of how far the volume term pulls all forces below their targets, relative to them.

    For a spring of straight struts force and volume grow alike, V dq/dV = q, so the objective
    ``sum w/2 (q - q*)^2 + k_rho V`` is stationary at ``(q* - q)/q* = k_rho V / sum w q*^2``, with
    V the volume of the struts that carry the largest target. At 0.5 no spring at all costs less.
    """
    volume = 0.0
    weight = 0.0
    for point in _blueprint(problem):
        bound = abs(block_force(problem, point.d))
        volume = max(volume, abs(point.q) / bound * problem.top_area * problem.H)
        weight += point.weight * point.q**2
    return math.inf if weight == 0.0 else problem.k_rho * volume / weight


def _volume(problem: SpringProblem) -> Iterator[Finding]:
    shift = volume_shift(problem)
    if NEGLIGIBLE_SHIFT <= shift <= VISIBLE_SHIFT or problem.k_rho == 0.0:
        return
    similar = with_similar_weights(problem)
    largest = max(point.weight for point in similar.control_points)
    advice = (
        f"weights like the paper's would be w_q (weight) = {largest:.2g} N^-2 and"
        f" k_rho = {similar.k_rho:.2g}"
    )
    if not any(point.q for point in problem.control_points):
        return
    if shift >= 0.5:
        yield Finding(
            "error",
            "with these weights no spring at all is cheaper than one that meets the targets: the"
            f" volume term would remove it; {advice}",
        )
    elif shift > VISIBLE_SHIFT:
        yield Finding(
            "warning",
            f"the volume term will pull the forces about {100 * shift:.2g} % below the targets;"
            f" {advice}",
        )
    else:
        yield Finding(
            "warning",
            "next to the targets the volume hardly counts (it shifts the forces by"
            f" {100 * shift:.1g} %): designs of very different volume are equally good to the"
            f" digits available; {advice}",
        )


def _stretch(problem: SpringProblem) -> Iterator[Finding]:
    largest = max(abs(point.d) for point in problem.control_points)
    if largest > EXTREME_STRETCH * problem.H:
        yield Finding(
            "warning",
            f"d up to {100 * largest / problem.H:.0f} % of H: beyond what the third medium has been"
            " tried with (the paper goes to 20 %); the load path may not be followed to its end",
        )
    if largest < SMALL_STRETCH * problem.H and not _may_be_in_metres(problem):
        yield Finding("warning", _too_small(problem))


def _law(problem: SpringProblem) -> Iterator[Finding]:
    stretches = [1 + point.d / problem.H for point in problem.control_points]
    largest = max(max(stretch, 1 / stretch) for stretch in stretches)
    limit, test = first_limit(problem.law, problem.motion)
    if largest > limit:
        yield Finding(
            "warning",
            f"the spring as a whole is stretched or compressed by a factor of {largest:.3g}, but"
            f" the {problem.law.name} law is stable only up to a principal stretch of"
            f" {limit:.3g} ({test})",
        )
    elif limit < SOON_STRETCHED:
        yield Finding(
            "note",
            f"the {problem.law.name} law is stable only up to a principal stretch of"
            f" {limit:.3g} ({test}): ngspring verify tells whether the part goes beyond",
        )


def _may_be_in_metres(problem: SpringProblem) -> bool:
    """Whether displacements too small to be meant would be usual ones if they were in m."""
    largest = max(abs(point.d) for point in problem.control_points) / problem.H
    return largest < SMALL_STRETCH and 1e-2 <= 1e3 * largest < 1.0


def _too_small(problem: SpringProblem, hint: str = "") -> str:
    largest = max(abs(point.d) for point in problem.control_points)
    return (
        f"d only up to {100 * largest / problem.H:.2g} % of H: too little for contact or nonlinear"
        f" behaviour{hint}"
    )


def _exponents(
    points: Sequence[ControlPoint],
) -> Iterator[tuple[float, ControlPoint, ControlPoint]]:
    """ln(q_2/q_1) / ln(d_2/d_1) for neighbours on one side of zero: 1 is linear."""
    for side in (1.0, -1.0):
        row = sorted(
            (p for p in points if p.d * side > 0 and p.q * side > 0), key=lambda p: p.d * side
        )
        for one, two in pairwise(row):
            yield math.log(two.q / one.q) / math.log(two.d / one.d), one, two


def _shape(problem: SpringProblem) -> Iterator[Finding]:
    softening = False
    for exponent, one, two in _exponents(_blueprint(problem)):
        low, high = TRIED_TENSION if one.d > 0 else TRIED_COMPRESSION
        softening |= one.d > 0 and exponent < 0.97
        if not low - 0.01 <= exponent <= high + 0.01:
            kind = "softens" if exponent < low else "stiffens"
            side = "tension" if one.d > 0 else "compression"
            yield Finding(
                "note",
                f"from d = {one.d:g} to {two.d:g} mm the target {kind} more than any of the"
                f" paper's in {side}: q ~ d^{exponent:.2f}, tried are {low:g} to {high:g}",
            )
    if softening and not any(p.eta > 0.0 and p.d > 0.0 for p in problem.control_points):
        eta = 0.25 * problem.H / 100 * 8 / problem.l_i
        yield Finding(
            "warning",
            "the target softens in tension, which needs a neck; grey material would mimic it."
            " As for T1 and T2 of the paper, repeat the outermost tension point with"
            f" eta = {eta:.2g} (a dilation by H/400) and a ten-thousandth of its weight, and"
            " double the elements",
        )


def _sides(problem: SpringProblem) -> Iterator[Finding]:
    points = _blueprint(problem)
    # Of a point with the wrong sign, or without a force, no example can be made.
    examples = [p for p in points if p.q < 0]
    if all(p.d < 0 for p in points) and examples:
        first = examples[-1]
        yield Finding(
            "warning",
            "no target in tension: parts that only touch under compression would do, so the"
            " spring need not be connected. A point in tension makes it so, as in all of the"
            " paper's compression springs: add a row to the CSV, or a [[control_points]] to the"
            f" TOML, for example with d = {-first.d:g} mm, q = {-first.q:g} N",
        )


def _numerics(problem: SpringProblem) -> Iterator[Finding]:
    advice = nu_advice(young_and_poisson(problem.K, problem.G)[1])
    if advice:
        yield Finding("warning", advice)
    element = max(problem.h_x, problem.h_y)
    if problem.l_i < 0.7 * element:
        yield Finding(
            "warning",
            f"l_i = {problem.l_i:g} mm is thinner than the mesh resolves: an element is"
            f" {element:g} mm wide; the paper has l_i = 0.8 elements",
        )
    ratio = max(problem.L, problem.H) / min(problem.L, problem.H)
    if ratio > 2.0:
        yield Finding(
            "note",
            f"L and H differ by a factor of {ratio:.3g}, and so do the sides of the elements",
        )
