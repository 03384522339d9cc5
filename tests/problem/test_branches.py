"""Loading and unloading, machines that wait, and paths that are no function of d."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.curve import TargetCurve, parse_curve


def read(d: FloatArray, q: FloatArray, branch: str | None = None) -> TargetCurve:
    rows = "\n".join(f"{a!r},{b!r}" for a, b in zip(d.tolist(), q.tolist(), strict=True))
    return parse_curve(f"d [mm],q [N]\n{rows}", 100.0, 100.0, branch=branch)


def exact(d: FloatArray | float, sign: float) -> FloatArray:
    """The loading (1) or unloading (-1) branch of a loop between 0 and -10 or 10 mm."""
    d = np.asarray(d)
    return 0.2 * d + sign * 0.5 * np.sin(np.pi * d / 10)


def loop(
    end: float = -10.0, count: int = 50, shift: float = 0.0, wait: int = 1
) -> tuple[FloatArray, FloatArray]:
    """A loop whose way back is shifted, and on which the machine waits at 4.05 mm."""
    there = np.linspace(0.0, end, count + 1)[1:]
    back = np.sort(np.append(there[:-1], 0.405 * end)) + shift
    back = back if end < 0 else back[::-1]
    back = np.repeat(back, np.where(np.isclose(back - shift, 0.405 * end), wait, 1))
    return np.append(there, back), np.append(exact(there, 1.0), exact(back, -1.0))


BRANCHES = [(None, -1.5), ("loading", -1.5), ("unloading", -0.5), ("mean", -1.0)]


@pytest.mark.parametrize(("branch", "force"), BRANCHES)
@pytest.mark.parametrize("end", [-10.0, 10.0])
@pytest.mark.parametrize("count", [8, 50, 400])
@pytest.mark.parametrize(("shift", "wait"), [(0.0, 1), (0.01, 1), (0.0, 60), (0.01, 1000)])
def test_a_branch_of_a_loop_is_taken(
    branch: str | None, force: float, end: float, count: int, shift: float, wait: int
) -> None:
    curve = read(*loop(end, count, shift, wait), branch)
    sides = {"loading": [1.0], "unloading": [-1.0], "mean": [1.0, -1.0]}[branch or "loading"]
    close = 2e-2 if count == 8 else 2e-3
    for d in 0.01 * end * np.array([20.0, 40.5, 50.0, 75.0]):
        expected = np.mean([exact(d, sign) for sign in sides])
        assert float(curve.force(d)) == pytest.approx(float(expected), abs=4 * close)
    assert float(curve.force(end / 2)) == pytest.approx(-np.sign(end) * force, abs=close)
    said = next(remark for remark in curve.remarks if "loading and unloading differ" in remark)
    assert ("--branch unloading or mean takes another" in said) == (branch is None)


def test_both_sides_of_a_test_have_their_branches() -> None:
    parts = [loop(10.0), loop(-10.0)]
    d, q = (np.concatenate(values) for values in zip(*parts, strict=True))
    for branch, sign in (("loading", 1.0), ("unloading", -1.0)):
        curve = read(d, q, branch)
        for at in (-5.0, 5.0):
            assert float(curve.force(at)) == pytest.approx(float(exact(at, sign)), abs=2e-3)


def test_the_last_of_several_loops_counts() -> None:
    # It softens from loop to loop; a small one at the end is none that counts.
    parts = [(d, q * factor) for factor, (d, q) in zip((1.0, 0.9, 0.8), [loop()] * 3, strict=True)]
    small = (np.array([-1.0, -2.0, -1.5, -1.0]), np.array([-0.1, -0.2, -0.1, -0.05]))
    d, q = (np.concatenate(values) for values in zip(*parts, small, strict=True))
    curve = read(d, q)
    assert float(curve.force(-5.0)) == pytest.approx(-1.2, abs=2e-3)
    assert "of the last of" in curve.remarks[-1]


def test_loading_after_a_part_of_unloading_keeps_its_beginning() -> None:
    d = np.array([0, 2, 4, 6, 5, 4, 3, 4, 5, 6, 8, 10.0])
    q = np.array([0, 0.4, 0.8, 1.2, 0.9, 0.6, 0.4, 0.6, 0.85, 1.15, 1.6, 2.0])
    curve = read(d, q)
    assert curve.d[:2].tolist() == [0.0, 2.0]
    assert curve.d[-1] == 10.0
    with pytest.raises(ProblemError, match="only d = 3 to 6 mm in common"):
        read(d, q, "mean")


def test_a_table_to_which_points_were_added_is_one_curve() -> None:
    d = np.array([0, 4, 8, 12, 2, 6, 10.0])
    curve = read(d, 0.01 * d**2)
    assert curve.d.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    assert "all are taken, sorted by d" in curve.remarks[-1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [12, 200])
@pytest.mark.parametrize("smooth", [True, False])
def test_a_snap_back_is_no_function_of_d(smooth: bool, count: int, sign: float) -> None:
    s = np.linspace(0.0, 1.0, count)
    # Both turn back in d while the force falls, and go on below where they were.
    d, q = (np.interp(s, [0, 0.4, 0.6, 1], at) for at in ([0, 10, 8, 20], [0, 5, 2, 6]))
    if smooth:
        t = -1.2 + 2.6 * s
        d, q = (k * (t**3 - c * t) for k, c in ((8.0, 0.5), (2.0, 0.9)))
        d, q = d - d[0], q - q[0]
    for branch in (None, "loading"):
        with pytest.raises(ProblemError, match=r"snap-back.*no function of d") as error:
            read(sign * d, sign * q, branch)
        assert len(str(error.value)) <= 300


@given(order=st.permutations(range(8)))
def test_a_table_in_no_order_is_sorted(order: list[int]) -> None:
    # A straight line: whatever the order, there is nothing to choose.
    curve = read(1.0 + np.array(order), 0.2 * (1.0 + np.array(order)))
    assert curve.d.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert not [remark for remark in curve.remarks if "loading" in remark]


def test_a_branch_of_a_curve_without_loops_is_the_curve() -> None:
    d = np.linspace(0, 10, 30)
    curve = read(d, 0.2 * d, "mean")
    assert curve.d.tolist() == d.tolist()
    assert "no loops: --branch mean changes nothing" in curve.remarks[-1]


def test_a_force_that_relaxes_while_the_machine_waits_is_told() -> None:
    d = np.concatenate([np.linspace(0, 5, 50), np.full(300, 5.0), np.linspace(5, 10, 50)[1:]])
    q = 0.2 * d
    q[50:350] -= np.linspace(0, 0.2, 300)
    for repeats in (1, 7):
        times = np.where(np.arange(len(d)) < 350, repeats, 1)
        curve = read(np.repeat(d, times), np.repeat(q, times))
        assert float(curve.force(5.0)) == pytest.approx(0.9, abs=1e-9)
        assert "0.8 to 1 N (the machine waited" in curve.remarks[-1]


def test_repeated_runs_without_a_way_back_are_not_averaged() -> None:
    d = np.tile(np.linspace(1, 10, 20), 2)
    q = np.append(0.2 * d[:20], 0.3 * d[20:])
    curve = read(d, q)
    assert curve.q == pytest.approx(0.3 * curve.d)
    assert "measured 2 times: the last one is taken" in curve.remarks[-1]
