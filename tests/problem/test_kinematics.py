"""A kinematics says what a place of the plane stands for."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring.problem.kinematics import KINEMATICS

L, H, T = 90.0, 110.0, 1.7


def test_a_full_block_is_as_wide_as_the_domain(kinematics: str) -> None:
    motion = KINEMATICS[kinematics]
    volume = motion.volume(L, H, T)
    assert volume == pytest.approx(motion.top_area(L, T) * H)
    assert motion.equivalent_width(volume, H, T) == pytest.approx(L)


def test_the_variation_of_f_33_is_its_derivative(kinematics: str) -> None:
    motion = KINEMATICS[kinematics]
    x = np.array([1.0, 20.0, 44.0])
    change = motion.F_33(0.3, x, L) - motion.F_33(0.1, x, L)
    delta = motion.delta_F_33(0.2, x, L)
    np.testing.assert_allclose(change, 0.0 if delta is None else delta, atol=1e-14)
    assert motion.F_33(0.0, 1.0, L) == 1.0


def test_only_a_body_of_revolution_has_a_radius_and_no_thickness(kinematics: str) -> None:
    motion = KINEMATICS[kinematics]
    thicker = motion.measure(20.0, L, 2 * T) / motion.measure(20.0, L, T)
    assert thicker == (2.0 if motion.thick else 1.0)
    assert (motion.measure(30.0, L, T) == motion.measure(20.0, L, T)) != motion.axis
    assert motion.axis == (motion.sweep == "revolved")
