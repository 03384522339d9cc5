"""From the path of a test to one force for each displacement.

A test machine loads and unloads, waits, and does so several times; forces differ by hysteresis.
The branches are told apart by the direction of d: loading goes away from d = 0, unloading back to
it, in tension and in compression. Points are never averaged across branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import choice
from ngspring.basics.errors import ProblemError

BRANCHES = ("loading", "unloading", "mean")

#: A path that turns back by less than this part of its range has not turned: noise.
_NOISE = 0.02
#: Points closer than these parts of the range are one place where the machine waits, and one point
#: of a curve that has more than `_MANY`.
_SAME, _BIN, _MANY = 1e-4, 1 / 200, 50
#: A spread of forces at one displacement below this part of the largest force is not worth a word.
_VISIBLE = 0.05

#: Displacements and forces.
Curve = tuple[FloatArray, FloatArray]


def single_valued(d: FloatArray, q: FloatArray, branch: str | None, remarks: list[str]) -> Curve:
    """Displacements, increasing and each once, with their forces, from a path in its own order.

    Parameters
    ----------
    d, q : arrays (points,)
    branch : {"loading", "unloading", "mean"}, optional
        What to take of a path with loops: loading by default. The mean is that of the two curves,
        where both exist. Of several loops the last one counts, as in standards for rubber, that
        covers the range.
    remarks : list of str
        What was done is added.

    Raises
    ------
    ProblemError
        If the path snaps back: then it is no function of d; or if a mean is asked for, but loading
        and unloading have less than half of the displacements in common.
    """
    if branch is not None:
        choice("branch", branch, BRANCHES)
    d, q = _without_waiting(d, q, remarks)
    legs = _legs(d)
    apart = _apart(d, q, legs)
    if apart > (0.0 if len(d) > _MANY else _VISIBLE):
        _refuse_snap_back(d, q, legs)
        return _of_branches(_branches(d, q, legs), branch, remarks)
    if apart:
        remarks.append(
            "the rows go forth and back in d, with forces that differ by at most"
            f" {100 * apart:.2g} % of the largest: all are taken, sorted by d"
        )
    if branch is not None:
        remarks.append(f"the curve has no loops: --branch {branch} changes nothing")
    return _in_order(d, q, remarks)


def _in_order(d: FloatArray, q: FloatArray, remarks: list[str]) -> Curve:
    """One branch, sorted by d, with close points averaged where there are many."""
    order = np.argsort(d, kind="stable")
    return _thinned(*_without_waiting(d[order], q[order], remarks))


def _without_waiting(d: FloatArray, q: FloatArray, remarks: list[str]) -> Curve:
    """A point for each place where the path stays: there, the middle of the forces.

    However many samples the machine has written meanwhile.
    """
    close = _SAME * np.ptp(d) if len(d) > _MANY else 0.0
    starts = [0]
    for k, value in enumerate(d.tolist()):
        if abs(value - d[starts[-1]]) > close:
            starts.append(k)
    least, most = np.minimum.reduceat(q, starts), np.maximum.reduceat(q, starts)
    worst = int((most - least).argmax())
    if most[worst] - least[worst] > _VISIBLE * np.abs(q).max():
        remarks.append(
            f"different forces at d = {d[starts[worst]]:.4g} mm, {least[worst]:.3g} to"
            f" {most[worst]:.3g} N (the machine waited, or noise): their middle is taken"
        )
    low, high = np.minimum.reduceat(d, starts), np.maximum.reduceat(d, starts)
    # The ends of the curve stay as they are.
    place = np.where(low == d.min(), low, np.where(high == d.max(), high, 0.5 * (low + high)))
    return place, 0.5 * (least + most)


def _thinned(d: FloatArray, q: FloatArray) -> Curve:
    """A sorted curve of many points with the means of close ones; its ends stay as they are."""
    if len(d) <= _MANY:
        return d, q
    width = _BIN * (d[-1] - d[0])
    groups: list[list[int]] = [[0]]
    for k in range(1, len(d)):
        first = d[groups[-1][0]]
        inside = d[0] < first and d[k] < d[-1] and (d[k] > 0) == (first > 0)
        if inside and d[k] - first <= width:
            groups[-1].append(k)
        else:
            groups.append([k])
    return (
        np.array([d[group].mean() for group in groups]),
        np.array([q[group].mean() for group in groups]),
    )


# -- the directions of a path ----------------------------------------------------------------------


def _legs(d: FloatArray) -> list[slice]:
    """The parts of a path in one direction, each with both of its ends."""
    slack = _NOISE * np.ptp(d)
    turns, extreme, sense = [0], 0, 0.0
    for k, value in enumerate(d.tolist()):
        step = value - d[extreme]
        if step * sense > 0.0 or (sense == 0.0 and abs(step) > slack):
            extreme, sense = k, float(np.sign(step))
        elif sense and abs(step) > slack:
            turns.append(extreme)
            extreme, sense = k, -sense
    return [slice(a, b + 1) for a, b in pairwise([*turns, len(d) - 1])]


def _apart(d: FloatArray, q: FloatArray, legs: Sequence[slice]) -> float:
    """How far a path is from itself where it goes over the same displacements again.

    Relative to the largest force; zero if it does not, as in a table in no order of d.
    """
    if len(legs) > len(d) / 2:
        return 0.0
    apart = 0.0
    for one, other in pairwise(leg for leg in legs if _is_measured(leg)):
        again = np.arange(other.start + 1, other.stop)
        again = again[(d[one].min() < d[again]) & (d[again] < d[one].max())]
        if again.size:
            difference = np.abs(q[again] - _interpolated(d[one], q[one], d[again])).max()
            apart = max(apart, difference / np.abs(q).max(initial=1e-300), 1e-15)
    return float(apart)


def _is_measured(leg: slice) -> bool:
    """Whether a leg is more than two points, which are a jump, for example back to the start."""
    return bool(leg.stop - leg.start > 2)


def _interpolated(d: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    order = np.argsort(d, kind="stable")
    return np.interp(at, d[order], q[order])


def _refuse_snap_back(d: FloatArray, q: FloatArray, legs: Sequence[slice]) -> None:
    """Raise ProblemError if d turns back, the force falls, and the path never returns to it.

    After unloading, loading again meets the path where it was left, with a little less force; after
    a snap-back it passes far below.
    """
    for one, back, again in zip(legs, legs[1:], legs[2:], strict=False):
        top, bottom = one.stop - 1, back.stop - 1
        sense = np.sign(d[top] - d[one.start])
        x, y = sense * d, sense * q
        drop = y[top] - y[bottom]
        small = drop <= _VISIBLE * np.abs(q).max()
        anew = not _is_measured(back) and x[bottom] < 0.9 * x[one.start] + 0.1 * x[top]
        if small or anew or x[again].max() < x[top]:
            continue
        returned = _interpolated(x[again], y[again], x[top : top + 1])[0] - y[bottom]
        if returned < 0.5 * drop:
            raise ProblemError(
                f"the path turns back at d = {d[top]:.4g} mm while the force falls, and goes on"
                f" below it from d = {d[bottom]:.4g} mm (snap-back): it is no function of d, which"
                " a target has to be; leave that part out"
            )


# -- branches --------------------------------------------------------------------------------------


def _of_branches(
    branches: dict[tuple[int, str], list[Curve]], branch: str | None, remarks: list[str]
) -> Curve:
    """What is asked for of both sides of d = 0, one after the other."""
    chosen: list[Curve] = []
    slack = _NOISE * np.ptp(np.concatenate([d for parts in branches.values() for d, _ in parts]))
    loops, differences = 0, []
    for side in (-1, 1):
        both = [branches.get((side, kind), []) for kind in BRANCHES[:2]]
        loops = max(loops, *map(len, both))
        curves = [_in_order(*_last_full(parts, slack), []) for parts in both if parts]
        if len(curves) == 2:
            grid, one, two = _on_common(*curves)
            k = int(np.abs(one - two).argmax())
            differences.append((abs(one[k] - two[k]), grid[k], one[k], two[k]))
            mean = (grid, 0.5 * (one + two))
            if branch == "mean" and np.ptp(grid) < 0.5 * max(np.ptp(d) for d, _ in curves):
                raise ProblemError(
                    f"loading and unloading have only d = {grid[0]:.4g} to {grid[-1]:.4g} mm in"
                    " common, too little for a mean: take one of them"
                )
            curves = [mean if branch == "mean" else curves[BRANCHES.index(branch or "loading")]]
        chosen += curves
    if differences:
        _, where, loading, unloading = max(differences)
        taken = "the mean of the two curves" if branch == "mean" else branch or "loading"
        remarks.append(
            f"loading and unloading differ (at d = {where:.4g} mm {loading:.4g} and"
            f" {unloading:.4g} N): {taken} is taken"
            + (f", of the last of {loops} loops" if loops > 1 else "")
            + ("" if branch else "; --branch unloading or mean takes another")
        )
    elif loops > 1:
        remarks.append(f"the curve was measured {loops} times: the last one is taken")
    d, q = (np.concatenate(values) for values in zip(*chosen, strict=True))
    return _in_order(d, q, remarks)


def _branches(
    d: FloatArray, q: FloatArray, legs: Sequence[slice]
) -> dict[tuple[int, str], list[Curve]]:
    """The parts of a path by side of d = 0 and direction, in the order in which they were made."""
    found: dict[tuple[int, str], list[Curve]] = {}
    slack = _NOISE * np.ptp(d)
    for leg in filter(_is_measured, legs):
        for side in (-1, 1):
            part = d[leg] * side >= 0.0
            if np.abs(d[leg][part]).max(initial=0.0) <= slack:
                continue
            outward = (d[leg.stop - 1] - d[leg.start]) * side > 0.0
            kind = "loading" if outward else "unloading"
            found.setdefault((side, kind), []).append((d[leg][part], q[leg][part]))
    return found


def _last_full(parts: Sequence[Curve], slack: float) -> Curve:
    """The last one that goes nearly as far as any; where others go farther, followed by these."""
    widest = max(np.ptp(d) for d, _ in parts)
    d, q = [part for part in parts if np.ptp(part[0]) >= 0.8 * widest][-1]
    for d_of, q_of in reversed(parts):
        low, high = d.min(), d.max()
        farther = np.zeros(len(d_of), bool)
        if d_of.min() < low - slack:
            farther |= d_of < low
        if d_of.max() > high + slack:
            farther |= d_of > high
        d, q = np.append(d, d_of[farther]), np.append(q, q_of[farther])
    return d, q


def _on_common(one: Curve, other: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Displacements that both curves have, and the forces of both there.

    Raises
    ------
    ProblemError
        If there are none.
    """
    low, high = max(one[0][0], other[0][0]), min(one[0][-1], other[0][-1])
    grid = np.union1d(one[0], other[0])
    grid = grid[(low <= grid) & (grid <= high)]
    if not grid.size:
        raise ProblemError("loading and unloading have no displacement in common: leave one out")
    return grid, np.interp(grid, *one), np.interp(grid, *other)
