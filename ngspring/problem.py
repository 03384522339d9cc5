"""What is to be designed: the target load path, the material, the mesh and the weights.

The fields carry the letters of the paper and the defaults of its Table 1. Lengths are in mm, forces
in N and stresses in MPa.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import numbers
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ngspring.errors import ProblemError

KINEMATICS = ("plane strain", "axisymmetric")
DOMAINS = ("quarter", "full")

_POSITIVE = ("L", "H", "T", "K", "G", "l_i", "l_t")
_NON_NEGATIVE = ("k_r", "p", "k_rho", "k_i", "k_H")
_LONGEST_SHOWN = 80


def shown(value: object) -> str:
    """Return `value` as it appears in an error message: one line of at most 80 characters."""
    try:
        text = repr(value)
    except Exception:  # Python refuses to print integers of more than 4300 digits
        text = f"<{type(value).__name__}>"
    text = " ".join(line.strip() for line in text.splitlines())
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


def nearest(word: str, choices: Iterable[str]) -> str:
    """Return the one of `choices` that is spelled most like `word`, whatever the case."""
    folded = {choice.casefold(): choice for choice in choices}
    return folded[difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.0)[0]]


def _refuse(field: str, value: object, right: str) -> ProblemError:
    return ProblemError(f"{field} = {shown(value)} is not valid: it must be {right}")


def finite_number(field: str, value: object) -> float:
    """Return `value` as a float.

    Raises
    ------
    ProblemError
        If it is not a finite number; the message names `field`.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise _refuse(field, value, "a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise _refuse(field, value, "a finite number")
    return number


def _choice(field: str, value: object, choices: tuple[str, ...]) -> str:
    right = " or ".join(map(repr, choices))
    if not isinstance(value, str):
        raise _refuse(field, value, right)
    if value not in choices:
        raise _refuse(field, value, f"{right} (did you mean {nearest(value, choices)!r}?)")
    return value


@dataclass(frozen=True)
class ControlPoint:
    """One point of the target load path, with its term w/2 (q - q_*)² in the objective (Eq. 9).

    Parameters
    ----------
    d : float
        Prescribed displacement of the top side in mm; positive is tension.
    q : float
        Target reaction force q_* in N; positive is tension.
    weight : float
        Weight w_q of the term in N⁻².
    eta : float
        Offset of chi in the mechanics of this point (section 2.6): the design that is loaded is the
        one with chi + eta, whose solid is dilated by l_i eta / 8; negative values erode it.

    Raises
    ------
    ProblemError
        If a value is not a finite number, `d` is zero or `weight` is not positive.
    """

    d: float
    q: float
    weight: float = 1.0
    eta: float = 0.0

    def __post_init__(self) -> None:
        for field in ("d", "q", "weight", "eta"):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        if self.d == 0.0:
            # The undeformed state is in equilibrium with q = 0 whatever the design.
            raise _refuse("d", self.d, "different from zero, where the force is zero anyway")
        if self.weight <= 0.0:
            raise _refuse("weight", self.weight, "positive")


def worst_deviation(points: Iterable[ControlPoint], forces: Iterable[float]) -> float | None:
    """Largest relative deviation of a force from its target, for points without eta.

    None if there is no force yet, or no target to compare it with.
    """
    far = [
        abs(q / point.q - 1)
        for point, q in zip(points, forces, strict=False)
        if point.q and not point.eta
    ]
    return max(far, default=None)


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
        Bulk and shear modulus of the solid in MPa (Eq. 14).
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
    L: float = 100.0
    H: float = 100.0
    T: float = 1.0
    K: float = 5 / 3
    G: float = 5 / 14
    E_0: float = 1e-6
    k_r: float = 1e-6
    p: float = 8.0
    k_rho: float = 1e-8
    k_i: float = 1e-2
    n: float = 6.0
    k_H: float = 1e-9
    l_i: float = 1.0
    l_t: float = 8.0

    def __post_init__(self) -> None:
        self._check_text()
        self._check_elements()
        self._check_numbers()
        self._check_control_points()

    def _check_text(self) -> None:
        _choice("kinematics", self.kinematics, KINEMATICS)
        _choice("domain", self.domain, DOMAINS)
        if not isinstance(self.name, str):
            raise _refuse("name", self.name, "a string")
        try:
            self.name.encode()
        except UnicodeEncodeError:
            # Such a name could be neither stored nor printed.
            raise _refuse("name", self.name, "text that UTF-8 can encode") from None

    def _check_elements(self) -> None:
        N: object = self.elements
        right = "an even integer of at least 4"
        if isinstance(N, bool) or not isinstance(N, numbers.Integral):
            raise _refuse("elements", N, right)
        if N < 4 or N % 2:
            raise _refuse("elements", N, f"{right}, because the symmetry axes are mesh lines")
        object.__setattr__(self, "elements", int(N))

    def _check_numbers(self) -> None:
        for field in (*_POSITIVE, *_NON_NEGATIVE, "E_0", "n"):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        for field in _POSITIVE:
            if getattr(self, field) <= 0.0:
                raise _refuse(field, getattr(self, field), "positive")
        for field in _NON_NEGATIVE:
            if getattr(self, field) < 0.0:
                raise _refuse(field, getattr(self, field), "zero or positive")
        if not 0.0 < self.E_0 < 1.0:
            raise _refuse("E_0", self.E_0, "between 0 and 1, both excluded")
        if self.n < 2.0:
            raise _refuse("n", self.n, "at least 2, or Newton's method has no second derivative")

    def _check_control_points(self) -> None:
        given: object = self.control_points
        right = "a sequence of ControlPoint(d, q)"
        if not isinstance(given, Iterable):
            raise _refuse("control_points", given, right)
        points = tuple(given)
        if not points:
            raise _refuse("control_points", points, f"{right} with at least one of them")
        first_with: dict[tuple[float, float], int] = {}
        for i, point in enumerate(points):
            field = f"control_points[{i}]"
            if not isinstance(point, ControlPoint):
                raise _refuse(field, point, "a ControlPoint(d, q)")
            if abs(point.d) >= self.H:
                raise _refuse(f"{field}.d", point.d, f"smaller in size than H = {self.H}")
            k = first_with.setdefault((point.d, point.eta), i)
            if k < i:
                where = f"control_points[{k}] and [{i}] both have d = {point.d}, eta = {point.eta}"
                if point.q == points[k].q:
                    raise ProblemError(f"{where}, q = {point.q}: each point must be given once")
                raise ProblemError(
                    f"{where} but contradict each other with q = {points[k].q} and {point.q}:"
                    " a displacement must have one target force"
                )
        object.__setattr__(self, "control_points", points)

    @property
    def axisymmetric(self) -> bool:
        """Whether the spring is a body of revolution (section 3.4)."""
        return self.kinematics == "axisymmetric"

    @property
    def quarter(self) -> bool:
        """Whether one quadrant is analysed instead of the full domain."""
        return self.domain == "quarter"

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
        return dataclasses.replace(self, **changes)

    def to_toml(self) -> str:
        """Return the problem as TOML text, from which `from_toml` makes an equal problem."""
        from ngspring.problem_toml import write_toml

        return write_toml(self)

    @classmethod
    def from_toml(cls, text_or_path: str | os.PathLike[str]) -> SpringProblem:
        """Read a problem from TOML; see `ngspring.problem_toml.read_toml`.

        Parameters
        ----------
        text_or_path : str or path
            A path, or a string that names an existing file or is one line that ends with
            ``.toml``, is read as a file; any other string is TOML text.

        Raises
        ------
        ProblemError
            If the file cannot be read, the TOML is malformed, a key is unknown or missing, or
            the problem is not valid.
        """
        from ngspring.problem_toml import read_toml

        return read_toml(text_or_path)
