"""Numbers in tables and sentences show what they are worth, however large or small."""

from __future__ import annotations

import pytest

from ngspring.basics.text import significant


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (2.5278e-06, 4, "2.528e-06"),
        (-0.00123456, 3, "-0.00123"),
        (0.86311234, 6, "0.863112"),
        (2.0, 5, "2.0000"),
        (2527.78, 6, "2527.78"),
        (2527.78, 4, "2528"),
        (-3782.5, 3, "-3782"),
        (131722.5, 4, "131722"),
        (2.5278e12, 4, "2.528e+12"),
        (float("nan"), 4, "-"),
        (float("inf"), 4, "-"),
    ],
)
def test_a_number_has_its_significant_digits_at_every_size(
    value: float, digits: int, text: str
) -> None:
    assert significant(value, digits) == text


def test_signs_and_what_rounding_leaves_of_zero() -> None:
    assert significant(0.148, 3, "+") == "+0.148"
    assert significant(-3e-18, 6, among=0.5) == "0"
    assert significant(-3e-18, 3, among=5e-18) == "-3.00e-18"
    assert significant(0.0, 4) == "0"
