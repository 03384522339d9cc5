"""What is analysed of a spring, and the mirror images that make the whole of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ngspring.basics.arrays import FloatArray


@dataclass(frozen=True)
class Mirror:
    """A line about which the analysed part is mirrored.

    The image of a place is ``size - coordinate`` along `axis`. A doubly symmetric design whose
    deformation stays symmetric moves as ``u_x(L - x, y) = -u_x(x, y)`` and
    ``u_y(x, H - y) = d - u_y(x, y)``.

    Attributes
    ----------
    axis : int
        0 for the line x = L/2, 1 for y = H/2.
    size : float
        L or H in mm.
    side, far : str
        Side of the analysed part that lies on the line, and the one opposite to it.
    rotation : bool
        Whether the line is the axis of a body of revolution, so that both images are one body.
    """

    axis: int
    size: float
    side: str
    far: str
    rotation: bool = False

    @property
    def signs(self) -> FloatArray:
        """Signs of the two components of a place or a displacement, (2,)."""
        signs = np.ones(2)
        signs[self.axis] = -1.0
        return signs

    @property
    def offset(self) -> FloatArray:
        """The image of a place is ``signs * place + offset``, (2,)."""
        offset = np.zeros(2)
        offset[self.axis] = self.size
        return offset

    def translation(self, d: float) -> FloatArray:
        """The image of a displacement is ``signs * u + translation``, (2,), at a prescribed d."""
        return np.array([0.0, d]) if self.axis == 1 else np.zeros(2)

    def places(self, places: FloatArray) -> FloatArray:
        """Images of places (..., 2) in mm."""
        return np.asarray(self.offset + self.signs * places)

    def displacements(self, u: FloatArray, d: float) -> FloatArray:
        """Displacements (..., 2) of the images in mm."""
        return np.asarray(self.translation(d) + self.signs * u)

    def extended(self, nodes: FloatArray, d: float) -> FloatArray:
        """A displacement field on a grid of nodes, (2, n, m), together with its image."""
        away = np.flip(nodes, 1 + self.axis)
        away = np.delete(away, 0, 1 + self.axis)
        image = np.moveaxis(self.displacements(np.moveaxis(away, 0, -1), d), -1, 0)
        return np.concatenate([nodes, image], axis=1 + self.axis)


@dataclass(frozen=True)
class Sector:
    """The analysed part ``[0, width] x [0, height]`` of the domain ``[0, L] x [0, H]``.

    Attributes
    ----------
    L, H : float
        Size of the full domain in mm.
    half_width, half_height : bool
        Whether the part ends at x = L/2, and at y = H/2.
    rotation : bool
        Whether x = L/2 is the axis of a body of revolution; then ``half_width`` holds.
    """

    L: float
    H: float
    half_width: bool
    half_height: bool
    rotation: bool = False

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the part in mm."""
        return (
            self.L / 2 if self.half_width else self.L,
            self.H / 2 if self.half_height else self.H,
        )

    def cells(self, elements: int) -> tuple[int, int]:
        """Number of elements of the part in x and y, out of ``elements`` of the full domain."""
        return (
            elements // 2 if self.half_width else elements,
            elements // 2 if self.half_height else elements,
        )

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """The lines about which the part is mirrored, in the order of the axes."""
        lines = (
            (self.half_width, Mirror(0, self.L, "right", "left", self.rotation)),
            (self.half_height, Mirror(1, self.H, "top", "bottom")),
        )
        return tuple(mirror for there, mirror in lines if there)

    @property
    def copies(self) -> int:
        """How many times the part stands in the whole; a body of revolution is one body."""
        return int(2 ** sum(not mirror.rotation for mirror in self.mirrors))

    @property
    def share(self) -> float:
        """Part of the prescribed d that the top side of the part moves by."""
        return 0.5 if self.half_height else 1.0

    def images(self) -> list[tuple[FloatArray, FloatArray]]:
        """Signs and offsets of all copies: image = offset + sign * place, the part itself first."""
        images = [(np.ones(2), np.zeros(2))]
        for mirror in self.mirrors:
            images += [
                (sign * mirror.signs, offset * mirror.signs + mirror.offset)
                for sign, offset in images
            ]
        return images

    def whole(self, nodes: FloatArray, d: float) -> FloatArray:
        """A displacement field on the part's grid of nodes, (2, n, m), on the whole domain."""
        for mirror in self.mirrors:
            nodes = mirror.extended(nodes, d)
        return nodes

    def copied(
        self, places: FloatArray, u: FloatArray, d: float
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Places and displacements (..., 2) in mm of the part and of its images."""
        found = [(places, u)]
        for mirror in self.mirrors:
            found += [(mirror.places(x), mirror.displacements(v, d)) for x, v in found]
        return found


@dataclass(frozen=True)
class Domain:
    """What a problem's ``domain`` stands for.

    Attributes
    ----------
    half_width, half_height : bool
        Whether half of the width and half of the height is analysed.
    words : str
    """

    half_width: bool
    half_height: bool
    words: str


#: By name, the default first; a new one is a line here.
DOMAINS: Mapping[str, Domain] = MappingProxyType(
    {
        "quarter": Domain(True, True, "one quarter"),
        "full": Domain(False, False, "full domain"),
    }
)


def sector_of(domain: str, L: float, H: float, rotation: bool) -> Sector:
    """The sector that a domain names; of a body of revolution only r > 0 is meshed."""
    part = DOMAINS[domain]
    return Sector(L, H, part.half_width or rotation, part.half_height, rotation)
