"""The published benchmark of a C whose arms touch (examples/paper/c_shape.py)."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ngspring.fem.process import parallel

PAPER = Path(__file__).parents[2] / "examples" / "paper"
pytestmark = pytest.mark.skipif(not PAPER.is_dir(), reason="the examples are not installed")


@pytest.fixture
def c_shape(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(PAPER)
    return importlib.import_module("c_shape")


def published(c_shape: ModuleType, *displacements: float) -> list[float]:
    return [c_shape.PUBLISHED[d] for d in displacements]


@pytest.mark.long
def test_the_lower_arm_rests_until_touched_and_then_goes_as_far_as_published(
    c_shape: ModuleType,
) -> None:
    """Within 1 %; where d is prescribed is our reading, see the script."""
    down = [-1.0, -1.4, -2.4]
    with parallel(1):
        curve = c_shape.real_contact(down, 0.2)
    assert abs(curve.u_a[0]) < 0.005
    np.testing.assert_allclose(curve.u_a[1:], published(c_shape, *down[1:]), rtol=0.01)


@pytest.mark.slow
def test_the_published_numbers_on_a_finer_mesh_and_the_third_medium_beside_them(
    c_shape: ModuleType,
) -> None:
    """The void acts before the arms touch, and matters less the further they are pressed."""
    down = [-1.4, -2.4]
    with parallel(1):
        contact = [c_shape.real_contact(d, 0.1).u_a for d in (down, [2.0])]
        medium = [c_shape.third_medium(d).u_a for d in (down, [2.0])]
    np.testing.assert_allclose(contact[0], published(c_shape, *down), rtol=0.01)
    assert abs(contact[1][0]) < 0.005
    assert medium[0][0] == pytest.approx(contact[0][0], rel=0.2)
    assert medium[0][1] == pytest.approx(contact[0][1], rel=0.01)
    # Pulled open, the void carries the other arm with it by 4 % of d.
    assert 0.0 < medium[1][0] < 0.1
