"""What is to be designed: the target load path, the material, the mesh and the weights.

The fields carry the letters of the paper and the defaults of its Table 1. Lengths are in mm, forces
in N and stresses in MPa.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ngspring.basics.checks import choice, finite_number, nearest, positive_number, refused
from ngspring.basics.errors import ProblemError
from ngspring.problem.dimension import dimensions, quantity, weights
from ngspring.problem.imperfection import checked_odd_in
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.kinematics.base import Kinematics, Value
from ngspring.problem.laws.base import Law
from ngspring.problem.laws.neo_hooke import NeoHooke
from ngspring.problem.offsets import with_offsets
from ngspring.problem.point import ControlPoint
from ngspring.problem.sector import DOMAINS, Sector, sector_of
from ngspring.problem.toml import parse_fields, read, write_fields

_POSITIVE = ("L", "H", "T", "K", "G", "l_i", "l_t")
LONGEST_NAME = 200
MOST_ELEMENTS, MOST_POINTS, LARGEST_N = 2000, 1000, 20.0
LARGEST_STRETCH = 100.0
#: k_s over k_rho, unless it is given. With n = 6 a strain whose relief is worth its own material is
#: (k_rho / (k_s rho^6))^(1/5) beyond the limit: 1.5 % at the solid's surface, where rho is 1/2.
STRAINS = 1e11
#: The same of k_w. With a tenth of it a wall of 9 mm that C4 is asked for stays 16 % too thin, with
#: ten times as much a wall that forces want thinner ends as a zigzag of chi.
THICKNESS = 1e3
#: How far a number, and a weight of the objective, may be from what fits the spring's size.
FARTHEST, HEAVIEST = 1e12, 1e60


@dataclass(frozen=True)
class SpringProblem:
    """A spring to be designed, with the parameters of Table 1.

    Parameters
    ----------
    control_points : tuple of ControlPoint
        The target load path; any iterable of control points is accepted and kept as a tuple.
    name : str
        Name for titles and files.
    kinematics : {"plane strain", "axisymmetric"}
        Deformation gradient of Eq. 13 or of Eq. 21. An axisymmetric spring has radius L/2.
    domain : {"quarter", "full"}
        Part of the spring that is analysed: one quadrant with the symmetries of the design, or
        everything (in the axisymmetric case the half with r > 0).
    elements : int
        N of the N x N mesh over L x H; even, because the symmetry axes must be mesh lines, and
        counted over L x H for both domains.
    L, H : float
        Length (or diameter) and height of the design domain in mm.
    T : float
        Out-of-plane thickness in mm; not used by axisymmetric springs.
    K, G : float
        Bulk and shear modulus of the solid in MPa (Eq. 14); with a `material` its initial moduli.
        Beyond nu = 0.45 a pressure field carries the excess of K, see `split_bulk_modulus`.
    E_0 : float
        Stiffness of void relative to solid (Eq. 3).
    k_r : float
        Scaling of the void regularisation (Eq. 14).
    p : float
        RAMP penalisation factor (Eq. 3).
    k_rho : float
        Weight of the volume (Eq. 11).
    k_i : float
        Weight of the interface width term (Eq. 11).
    n : float
        Exponent of the interface width term (Eq. 11).
    k_H : float
        Weight of the curvature of chi (Eq. 11).
    l_i : float
        Minimum interface width in mm: the slope of chi is limited to 8 / l_i (Eq. 11).
    l_t : float
        Length scale of the transient term in mm (Table 1; Eq. 11 prints l_i in its place).
    stretch_limit : float
        Largest principal stretch that the solid should have at the control points; 0 for none.
    energy_limit : float
        Largest strain energy density that it should have, in MPa; 0 for none.
    k_s : float
        Weight of strains beyond these limits; `STRAINS` times k_rho by default, if there is one.
    wall, gap : float
        Smallest wall and smallest gap in mm that the design should have; 0 for none.
    k_w : float
        Weight of walls and gaps that are thinner; `THICKNESS` times k_rho by default, if there is
        a smallest one.
    material : Law, optional
        Another law than the paper's, see `ngspring.problem.laws`.

    Raises
    ------
    ProblemError
        If a value has the wrong type or is out of range, or if two control points ask for the
        same displacement of the same design; the message names the field, the value and what
        would be right.
    """

    control_points: tuple[ControlPoint, ...]
    name: str = ""
    kinematics: str = "plane strain"
    domain: str = "quarter"
    elements: int = 80
    L: float = quantity(100.0, length=1)
    H: float = quantity(100.0, length=1)
    T: float = 1.0
    K: float = quantity(5 / 3, stress=1)
    G: float = quantity(5 / 14, stress=1)
    E_0: float = 1e-6
    k_r: float = 1e-6
    p: float = 8.0
    k_rho: float = quantity(1e-8, volume=-1, weighs="the volume")
    k_i: float = quantity(1e-2, volume=-1, slope=True, weighs="the interface width")
    n: float = 6.0
    k_H: float = quantity(1e-9, volume=-1, length=4, weighs="the curvature of chi")
    l_i: float = quantity(1.0, length=1)
    l_t: float = quantity(8.0, length=1)
    stretch_limit: float = 0.0
    energy_limit: float = quantity(0.0, stress=1)
    k_s: float = quantity(0.0, volume=-1, weighs="strains beyond their limit")
    wall: float = quantity(0.0, length=1)
    gap: float = quantity(0.0, length=1)
    k_w: float = quantity(0.0, volume=-1, weighs="walls and gaps that are too thin")
    material: Law | None = None

    def __post_init__(self) -> None:
        self._check_material()
        self._check_text()
        self._check_elements()
        self._check_numbers()
        self._check_limits()
        self._check_thickness()
        self._check_control_points()
        self._check_sizes()

    def _check_material(self) -> None:
        if self.material is None:
            return
        if not isinstance(self.material, Law):
            raise refused("material", self.material, "a law, such as NeoHooke(K, G)")
        for name, value in zip("KG", self.material.initial_moduli, strict=True):
            object.__setattr__(self, name, value)
        if isinstance(self.material, NeoHooke):
            # It has the fields K and G, as in files of older versions.
            object.__setattr__(self, "material", None)

    def _check_text(self) -> None:
        choice("kinematics", self.kinematics, tuple(KINEMATICS))
        choice("domain", self.domain, tuple(DOMAINS))
        # Anything else could be neither stored nor shown on a terminal.
        if not isinstance(self.name, str) or not self.name.isprintable():
            raise refused("name", self.name, "printable text")
        if len(self.name) > LONGEST_NAME:
            raise refused("name", self.name, f"at most {LONGEST_NAME} characters long")

    def _check_elements(self) -> None:
        N: object = self.elements
        right = f"an even integer of at least 4 and at most {MOST_ELEMENTS}"
        if isinstance(N, bool) or not isinstance(N, numbers.Integral):
            raise refused("elements", N, right)
        if not 4 <= int(N) <= MOST_ELEMENTS or N % 2:
            raise refused("elements", N, f"{right}, because the symmetry axes are mesh lines")
        object.__setattr__(self, "elements", int(N))

    def _check_numbers(self) -> None:
        not_negative = ("k_r", "p", *weights(self))
        for field in (*not_negative, "E_0", "n"):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        for field in _POSITIVE:
            object.__setattr__(self, field, _positive(field, getattr(self, field)))
        for field in not_negative:
            if getattr(self, field) < 0.0:
                raise refused(field, getattr(self, field), "zero or positive")
        if not 0.0 < self.E_0 < 1.0:
            raise refused("E_0", self.E_0, "between 0 and 1, both excluded")
        if not 2.0 <= self.n <= LARGEST_N:
            right = "at least 2, or Newton's method has no second derivative"
            raise refused("n", self.n, f"{right}, and at most {LARGEST_N:g}")
        for field in ("E_0", "k_r", "p"):
            _check_size(field, getattr(self, field), 1e-15, 1e15)

    def _check_limits(self) -> None:
        for field in ("stretch_limit", "energy_limit"):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        if self.stretch_limit and not 1.0 < self.stretch_limit <= LARGEST_STRETCH:
            right = f"more than 1 and at most {LARGEST_STRETCH:g}, or 0 for no limit"
            raise refused("stretch_limit", self.stretch_limit, right)
        if self.energy_limit < 0.0:
            raise refused("energy_limit", self.energy_limit, "positive, or 0 for no limit")
        if self.stretch_limit or self.energy_limit:
            self._weigh("k_s", STRAINS, "a limit of strains")

    def _check_thickness(self) -> None:
        for field in ("wall", "gap"):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
            if not 0.0 <= getattr(self, field) < min(self.L, self.H):
                right = "positive and smaller than L and H, or 0 for none"
                raise refused(field, getattr(self, field), right)
        if self.wall or self.gap:
            self._weigh("k_w", THICKNESS, "a smallest wall or gap")

    def _weigh(self, weight: str, by_volume: float, asked: str) -> None:
        """A weight that is needed and not given is so many times that of the volume."""
        if getattr(self, weight):
            return
        if not self.k_rho:
            raise ProblemError(f"{weight} is needed for {asked} where k_rho is 0")
        object.__setattr__(self, weight, by_volume * self.k_rho)

    def _check_control_points(self) -> None:
        given: object = self.control_points
        right = "a sequence of ControlPoint(d, q)"
        if not isinstance(given, Iterable):
            raise refused("control_points", given, right)
        points = tuple(given)
        if not points:
            raise refused("control_points", points, f"{right} with at least one of them")
        if len(points) > MOST_POINTS:
            right = f"at most {MOST_POINTS}: each costs as much as the first"
            raise refused("the number of control points", len(points), right)
        first_with: dict[tuple[float, float, float, str], int] = {}
        for i, point in enumerate(points):
            field = f"control_points[{i}]"
            if not isinstance(point, ControlPoint):
                raise refused(field, point, "a ControlPoint(d, q)")
            if abs(point.d) >= self.H:
                raise refused(f"{field}.d", point.d, f"smaller in size than H = {self.H}")
            if point.eta_odd:
                checked_odd_in(f"{field}.odd_in", point.odd_in, self.motion.axis)
            k = first_with.setdefault(point.place, i)
            if k < i:
                where = f"control_points[{k}] and [{i}] both have {point.words}"
                if point.q == points[k].q:
                    raise ProblemError(f"{where}, q = {point.q}: each point must be given once")
                raise ProblemError(
                    f"{where} but contradict each other with q = {points[k].q} and {point.q}:"
                    " a displacement must have one target force"
                )
        object.__setattr__(self, "control_points", points)

    def _check_sizes(self) -> None:
        """Refuse numbers so far apart that double precision cannot compute with them.

        What is large or small is relative to the size and stiffness of the spring itself.
        """
        a, v, E = math.sqrt(self.L * self.H), self.top_area * self.H, max(self.K, self.G)
        force = E * v / a
        for name, dimension in dimensions(self).items():
            unit = dimension.factor(a, v, E, self.n)
            bounds = (0.0, HEAVIEST) if name in weights(self) else (1 / FARTHEST, FARTHEST)
            _check_size(name, getattr(self, name), unit * bounds[0], unit * bounds[1])
        if self.motion.thick:
            _check_size("T", self.T, a / FARTHEST, a * FARTHEST)
        for i, point in enumerate(self.control_points):
            where = f"control_points[{i}]"
            units = {"d": a, "q": force, "q_star": force, "eta": 1.0, "eta_odd": 1.0}
            for name, unit in units.items():
                value = getattr(point, name)
                _check_size(f"{where}.{name}", value, unit / FARTHEST, unit * FARTHEST)
            unit = force**-2
            _check_size(f"{where}.weight", point.weight, unit / HEAVIEST, unit * HEAVIEST)

    @property
    def motion(self) -> Kinematics:
        """What `kinematics` names: deformation gradient, measure, meaning of the width."""
        return KINEMATICS[self.kinematics]

    @property
    def top_area(self) -> float:
        """Area in mm^2 of the loaded top side: L T, or the disc of diameter L."""
        return self.motion.top_area(self.L, self.T)

    @property
    def sector(self) -> Sector:
        """What `domain` names: the part that is analysed, and its mirror images."""
        return sector_of(self.domain, self.L, self.H, self.motion.axis)

    @property
    def law(self) -> Law:
        """The material's law: `material`, or the paper's (Eq. 14) with K and G."""
        return NeoHooke(self.K, self.G) if self.material is None else self.material

    def equivalent_width(self, volume: float) -> float:
        """Width W of Eq. 20 (plane strain) or diameter D of Eq. 25 (axisymmetric) in mm."""
        return self.motion.equivalent_width(volume, self.H, self.T)

    def measure(self, x: Value) -> Value:
        """Volume of the whole spring per area of the analysed part, in mm, at x in mm."""
        return self.sector.copies * self.motion.measure(x, self.L, self.T)

    @property
    def h_x(self) -> float:
        """Width of an element, L/N, in mm."""
        return self.L / self.elements

    @property
    def h_y(self) -> float:
        """Height of an element, H/N, in mm."""
        return self.H / self.elements

    @property
    def coefficient_shape(self) -> tuple[int, int]:
        """Number of independent spline coefficients of the doubly symmetric chi in x and in y.

        One coefficient per element of the quadrant, and one ghost layer outside the left side,
        where chi is free. None outside the bottom, where mirror symmetry ties it to the inside.
        """
        return self.elements // 2 + 1, self.elements // 2

    def replace(self, **changes: Any) -> SpringProblem:
        """Return a copy with some fields changed.

        Raises
        ------
        ProblemError
            If a field does not exist, or the changed problem is not valid.
        """
        names = [field.name for field in dataclasses.fields(self)]
        for field in changes:
            if field not in names:
                raise ProblemError(
                    f"SpringProblem has no field {field!r}: did you mean {nearest(field, names)!r}?"
                )
        if self.material is not None and "material" not in changes:
            for name in ("K", "G"):
                if name in changes:
                    raise ProblemError(
                        f"{name} belongs to the {self.law.name} law here: replace material"
                    )
        return dataclasses.replace(self, **changes)

    def with_offsets(self, **offsets: Any) -> SpringProblem:
        """The problem with control points whose surfaces are a little off.

        Parameters
        ----------
        **offsets
            ``robust`` and ``imperfection`` in mm, and ``odd_in``, see
            `ngspring.problem.offsets.with_offsets`.

        Raises
        ------
        ProblemError
            If one is not valid, or a target would be there twice.
        """
        points = with_offsets(self.control_points, self.l_i, axis=self.motion.axis, **offsets)
        return self.replace(control_points=points)

    def equals_but_for_name(self, other: SpringProblem) -> bool:
        """Whether a problem is the same, whatever its name: that may be corrected."""
        return self.replace(name=other.name) == other

    def to_toml(self) -> str:
        """Return the problem as TOML text, from which `from_toml` makes an equal problem."""
        values = dataclasses.asdict(self)
        if self.material is not None:
            # Its initial moduli follow from it.
            values |= {"K": None, "G": None}
            values["material"] = {"law": self.law.name, **self.law.parameters}
        return write_fields(values)

    @classmethod
    def from_toml(
        cls,
        text_or_path: str | os.PathLike[str],
        *,
        notes: list[str] | None = None,
        targets_anywhere: bool = False,
    ) -> SpringProblem:
        """Read a problem from TOML, see `ngspring.problem.toml`.

        Parameters
        ----------
        text_or_path : str or path
            A path, or a string that names an existing file or is one line that ends with
            ``.toml``, is read as a file; any other string is TOML text.
        notes : list of str, optional
            What was assumed about the curve of ``targets`` is added; without it, it is logged.
        targets_anywhere : bool
            Whether ``targets`` may name a file outside of the folder of the TOML file.

        Raises
        ------
        ProblemError
            If the file cannot be read, the TOML is malformed, a key is unknown or missing, or
            the problem is not valid.
        """
        parse = partial(cls.parse_toml, notes=notes, targets_anywhere=targets_anywhere)
        return read(text_or_path, parse)

    @classmethod
    def parse_toml(
        cls,
        text: str,
        folder: Path | None = None,
        notes: list[str] | None = None,
        targets_anywhere: bool = False,
    ) -> SpringProblem:
        """Read a problem from TOML text, never from a file of that name.

        Parameters
        ----------
        text : str
        folder : path, optional
            Where the file of ``targets`` is looked for; without it, such a key is refused.
        notes, targets_anywhere : optional
            See `from_toml`.

        Raises
        ------
        ProblemError
            See `from_toml`.
        """
        size = height_and_area
        return cls(**parse_fields(text, cls, size, folder, notes, targets_anywhere))


def _positive(field: str, value: object) -> float:
    """A length or a modulus; those of one spring are compared with each other afterwards."""
    number = positive_number(field, value)
    # With these, what has the size of a spring cannot overflow.
    _check_size(field, number, 1e-15, 1e15)
    return number


def _check_size(field: str, value: float, low: float, high: float) -> None:
    """Raise ProblemError if a number is neither zero nor, without its sign, from low to high."""
    if value and not low <= abs(value) <= high:
        right = f"from {low:.0e} to {high:.0e} in size"
        raise refused(field, value, f"{right}, or double precision cannot compute with it")


def height_and_area(values: Mapping[str, Any]) -> tuple[float, float]:
    """Height in mm and loaded area in mm^2 of a spring with these fields, or with the defaults.

    They turn the strains and stresses of a curve into d and q, see `ngspring.read_curve`.

    Raises
    ------
    ProblemError
        If one of ``kinematics``, ``L``, ``H`` and ``T`` is not valid.
    """
    names = ("kinematics", "L", "H", "T")
    size = {name: values.get(name, getattr(SpringProblem, name)) for name in names}
    kinematics = KINEMATICS[choice("kinematics", size.pop("kinematics"), tuple(KINEMATICS))]
    L, H, T = (_positive(name, value) for name, value in size.items())
    return H, kinematics.top_area(L, T)
