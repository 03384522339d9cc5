"""Which forces to ask for next, told by what the solids so far carry."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring import ControlPoint
from ngspring.basics.arrays import FloatArray
from ngspring.design.corrections import Correction
from ngspring.part.aims import LARGEST_CHANGE, SMALLEST_AIM, corrected_aims

POINTS = ControlPoint(10, 2), ControlPoint(-10, -2), ControlPoint(-20, -4)
TARGETS = np.array([point.q for point in POINTS])


def stiffer(aims: FloatArray) -> FloatArray:
    """A solid that is stiffer than asked for, whose control points feel each other."""
    shares = aims / TARGETS
    coupling = np.array([[1.05, 0.1, 0.02], [0.05, 1.2, -0.25], [-0.1, 0.3, 0.8]])
    return np.asarray(TARGETS * (coupling @ shares + 0.03 * shares**2))


def corrections(count: int, scale: float = 1.0) -> list[Correction]:
    found: list[Correction] = []
    aims = TARGETS.copy()
    for number in range(count):
        solid = stiffer(aims) * scale
        found.append(Correction(number, tuple(aims * scale), tuple(solid)))
        points = [ControlPoint(p.d, p.q * scale) for p in POINTS]
        aims = corrected_aims(found, points) / scale
    return found


def test_coupled_control_points_are_met_within_half_a_percent_after_a_few_corrections() -> None:
    worst = [abs(one.worst(POINTS)) for one in corrections(9)]
    assert worst[0] > 0.1
    assert min(worst[:6]) < 0.005
    assert worst[-1] < 1e-6


def test_a_solid_that_is_stiffer_by_a_factor_everywhere_is_met_by_one_correction() -> None:
    first = Correction(0, tuple(TARGETS), tuple(1.25 * TARGETS))
    np.testing.assert_allclose(corrected_aims([first], POINTS), TARGETS / 1.25, rtol=1e-14)


def test_the_unit_of_force_does_not_matter() -> None:
    ours, scaled = corrections(6), corrections(6, scale=1e6)
    for one, other in zip(ours, scaled, strict=True):
        np.testing.assert_allclose(other.aims, 1e6 * np.array(one.aims), rtol=1e-9)


def test_no_aim_changes_by_more_than_a_design_can_follow_or_changes_its_side() -> None:
    far = Correction(0, tuple(TARGETS), tuple(20.0 * TARGETS))
    aims = corrected_aims([far], POINTS)
    np.testing.assert_allclose(aims, (1 - LARGEST_CHANGE) * TARGETS)
    found = [far]
    for number in range(1, 6):
        found.append(Correction(number, tuple(aims), tuple(20.0 * TARGETS)))
        aims = corrected_aims(found, POINTS)
    assert (aims / TARGETS >= SMALLEST_AIM * (1 - 1e-12)).all()


def test_where_nothing_is_asked_for_the_largest_target_is_the_measure() -> None:
    points = ControlPoint(10, 2), ControlPoint(-10, 0)
    first = Correction(0, (2.0, 0.0), (2.0, 0.1))
    np.testing.assert_allclose(corrected_aims([first], points), [2.0, -0.1], rtol=1e-12)
    assert first.worst(points) == pytest.approx(0.05)


def test_half_the_way_goes_back_from_a_solid_that_cannot_be_computed() -> None:
    good = Correction(0, tuple(TARGETS), tuple(1.2 * TARGETS))
    lost = Correction(1, tuple(0.8 * TARGETS), (np.nan, -2.0, -4.0))
    np.testing.assert_allclose(corrected_aims([good, lost], POINTS), 0.9 * TARGETS)
    # What it carried is of no use for the slopes.
    again = Correction(2, tuple(0.9 * TARGETS), tuple(1.08 * TARGETS))
    np.testing.assert_allclose(corrected_aims([good, lost, again], POINTS), TARGETS / 1.2)
