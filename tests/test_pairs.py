"""Which points of a surface are inside which part of it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ngspring.contact import lobatto
from ngspring.pairs import PairSearch
from ngspring.splines import FloatArray
from ngspring.surface import Surface, outward, shapes, slopes

#: Nodes in micrometres of the tip of a flat hole that has folded on itself, as an analysis found
#: it: solid left of the line, the tip at (-101.8, 30.2), and the two flanks a micrometre inside
#: each other.
FOLD = np.array(
    [
        [112.69, -29.97],
        [84.19, -19.37],
        [56.09, -8.47],
        [30.29, -3.21],
        [4.5, -0.28],
        [-16.4, 2.57],
        [-36.42, 5.62],
        [-54.31, 8.87],
        [-69.64, 15.82],
        [-84.9, 23.17],
        [-101.85, 30.18],
        [-75.0, 17.21],
        [-53.96, 7.15],
        [-26.29, 3.5],
        [2.29, -0.68],
        [35.9, -1.97],
        [69.32, 0.55],
        [107.21, 10.04],
        [144.95, 19.69],
    ]
)


def fold() -> Surface:
    """The fold, and a long edge far from it, as there is in a mesh that is fine in the tip."""
    far = np.array([[5e3, 5e3], [3e3, 5e3], [1e3, 5e3]])
    nodes = 2 * np.arange(len(FOLD) // 2)[:, None] + np.arange(3)
    nodes = np.concatenate([nodes, [len(FOLD) + np.arange(3)]])
    rest = 1e-3 * np.concatenate([FOLD, far])
    return Surface(nodes, rest, sp.csr_matrix((len(rest),) * 2), np.zeros((len(nodes), 2), bool))


def feet(surface: Surface, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Gap of each point by looking at many places of every edge; 0 where it is inside of none."""
    gaps = np.zeros(len(points))
    s = np.linspace(0, 1, 20001)
    for nodes in surface.nodes:
        x, t = shapes(s) @ surface.rest[nodes], slopes(s) @ surface.rest[nodes]
        n = outward(t) / np.linalg.norm(t, axis=1)[:, None]
        for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
            i = int(np.argmin(((point - x) ** 2).sum(1)))
            gap = (point - x[i]) @ n[i]
            inside = 0 < i < len(s) - 1 and gap < -1e-6 and n[i] @ normal < -0.5
            if inside and (gaps[k] == 0.0 or gap > gaps[k]):
                gaps[k] = gap
    return gaps


def test_no_point_inside_a_sharp_fold_is_lost() -> None:
    """The edges that are nearest to a point in a fold are not always the ones it is inside of."""
    surface = fold()
    s, _ = lobatto(6)
    points = surface.at(surface.rest, s).reshape(-1, 2)
    normals = outward(surface.slopes_at(surface.rest, s)).reshape(-1, 2)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    expected = feet(surface, points, normals)
    pairs = PairSearch(surface, s).find(surface.rest)
    found = np.zeros(len(points))
    found[pairs.point] = np.minimum(pairs.gap, 0.0)
    inside = expected < 0.0
    assert inside.sum() > 20
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-7)
