"""The analysed part and its mirror images make the whole domain."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring import SpringProblem
from ngspring.problem.sector import Mirror


def test_the_images_of_a_part_cover_the_domain_once(coarse: SpringProblem) -> None:
    sector = coarse.sector
    width, height = sector.size
    images = sector.images()
    corners = np.array([[0.0, 0.0], [width, height]])
    boxes = [offset + sign * corners for sign, offset in images]
    area = sum(abs(np.prod(box[1] - box[0])) for box in boxes)
    assert area == pytest.approx(coarse.L * coarse.H)
    assert np.ptp([box[:, 0] for box in boxes]) == coarse.L
    assert np.ptp([box[:, 1] for box in boxes]) == coarse.H
    # Both images about the axis of a body of revolution are the same body.
    assert len(images) == sector.copies * (2 if coarse.motion.axis else 1)


def test_the_measure_makes_the_whole_volume_of_a_part(coarse: SpringProblem) -> None:
    width, height = coarse.sector.size
    x = (np.arange(1000) + 0.5) * width / 1000
    volume = np.mean(np.broadcast_to(coarse.measure(x), x.shape)) * width * height
    assert volume == pytest.approx(coarse.motion.volume(coarse.L, coarse.H, coarse.T))


def test_the_image_of_the_image_is_the_part_itself(random: np.random.Generator) -> None:
    places, u = random.uniform(size=(2, 7, 2))
    for mirror in (Mirror(0, 90.0, "right", "left"), Mirror(1, 110.0, "top", "bottom")):
        np.testing.assert_allclose(mirror.places(mirror.places(places)), places, atol=1e-13)
        np.testing.assert_allclose(mirror.displacements(mirror.displacements(u, 3.0), 3.0), u)


def test_a_symmetric_stretch_of_the_part_is_the_stretch_of_the_whole() -> None:
    problem = SpringProblem.from_toml("[[control_points]]\nd = 10\nq = 2\n")
    x, y = np.meshgrid(np.linspace(0, 50, 5), np.linspace(0, 50, 7), indexing="ij")
    part = np.stack([0.1 * (50 - x), y * 10.0 / 100])
    whole = problem.sector.whole(part, 10.0)
    x, y = np.meshgrid(np.linspace(0, 100, 9), np.linspace(0, 100, 13), indexing="ij")
    np.testing.assert_allclose(whole, np.stack([0.1 * (50 - x), y / 10]), atol=1e-13)
    copies = problem.sector.copied(np.zeros((1, 2)), np.array([[5.0, 0.0]]), 10.0)
    assert [(*place[0], *u[0]) for place, u in copies] == [
        (0, 0, 5, 0),
        (100, 0, -5, 0),
        (0, 100, 5, 10),
        (100, 100, -5, 10),
    ]
