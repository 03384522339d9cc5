"""Tests of a material: stretches and nominal stresses out of CSV files.

What a file may look like is found by `ngspring.problem.curves.table`, as for target curves: columns
of strain or stretch and stress, nominal or true, with units in their headings. Which test it was,
uniaxial, planar or equibiaxial, is said by whoever reads it, or by a word in the name of the file
or in the lines above its numbers.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import choice, real_array, shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import PathLike, naming, read_text
from ngspring.problem.curves.branches import single_valued
from ngspring.problem.curves.table import parse_columns
from ngspring.problem.laws.modes import MODES

#: Words, in lower case, that tell which test it was; the first that is found decides.
_WORDS = {
    "planar": r"planar|pure[\s_-]*shear|plane[\s_-]*strain",
    "equibiaxial": r"bi-?axial",
    "uniaxial": r"uni-?axial|tensile|dumb-?bell",
}
#: Stretches beyond these belong to no test.
SMALLEST, LARGEST = 0.02, 50.0
#: A stretch closer to 1 tells nothing about a law.
_AT_REST = 1e-9
#: Stresses of the wrong sign up to this part of the largest are noise.
_NOISE = 0.05
MOST_POINTS = 2000


@dataclass(frozen=True, eq=False)
class MaterialTest:
    """What one test measured.

    Attributes
    ----------
    test : {"uniaxial", "planar", "equibiaxial"}
    stretch : array (points,)
        Length over original length, in the direction of the force; below 1 in compression.
    stress : array (points,)
        Nominal stress, force over original area, in MPa; negative in compression.
    name : str
        Of the file.
    remarks : tuple of str
        What was assumed while it was read.

    Raises
    ------
    ProblemError
        If it has not at least two points apart from rest, or a number that cannot be.
    """

    test: str
    stretch: FloatArray
    stress: FloatArray
    name: str = ""
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        choice("test", self.test, tuple(MODES))
        stretch, stress = real_array("stretch", self.stretch), real_array("stress", self.stress)
        if stretch.ndim != 1 or stretch.shape != stress.shape:
            raise ProblemError(
                f"stretch and stress must be rows of the same length, not of the shapes"
                f" {stretch.shape} and {stress.shape}"
            )
        outside = stretch[(stretch < SMALLEST) | (stretch > LARGEST)]
        if outside.size:
            raise ProblemError(
                f"a stretch of {outside[0]:g} belongs to no test: it must be from {SMALLEST:g} to"
                f" {LARGEST:g} (is the strain in %, or is it a stretch? name its column strain [%]"
                " or stretch)"
            )
        moved = np.abs(stretch - 1.0) > _AT_REST
        if moved.sum() < 2:
            raise ProblemError(
                f"the test has {int(moved.sum())} points apart from rest, but a law needs at least"
                " two"
            )
        if moved.sum() > MOST_POINTS:
            places = np.flatnonzero(moved)
            moved[:] = False
            moved[places[np.linspace(0, len(places) - 1, MOST_POINTS).astype(int)]] = True
        object.__setattr__(self, "stretch", stretch[moved])
        object.__setattr__(self, "stress", stress[moved])
        self._check_signs()

    def _check_signs(self) -> None:
        wrong = self.stress * np.sign(self.stretch - 1.0)
        if not np.abs(self.stress).max() > 0.0:
            raise ProblemError("all stresses of the test are zero")
        k = int(wrong.argmin())
        if wrong[k] < -_NOISE * np.abs(self.stress).max():
            raise ProblemError(
                f"at a stretch of {self.stretch[k]:.4g} the stress is {self.stress[k]:.4g} MPa:"
                " tension, with a stretch above 1, has a positive stress, and compression a"
                " negative one"
            )

    def between(self, low: float, high: float) -> MaterialTest:
        """The same with the stretches from low to high only.

        Raises
        ------
        ProblemError
            If fewer than two points remain.
        """
        inside = (self.stretch >= low) & (self.stretch <= high)
        try:
            return MaterialTest(
                self.test, self.stretch[inside], self.stress[inside], self.name, self.remarks
            )
        except (ProblemError, ValueError):
            raise ProblemError(
                f"{self.name or self.test}: fewer than two points have stretches from {low:g} to"
                f" {high:g}"
            ) from None


def read_material_test(
    path: PathLike,
    test: str | None = None,
    *,
    compression: bool = False,
    branch: str | None = None,
    specimen: int | None = None,
) -> MaterialTest:
    """A test of a material from a CSV file.

    Parameters
    ----------
    path : path
        With columns of strain or stretch and of stress, see `ngspring.problem.curves.table`. True
        stresses and strains are converted.
    test : {"uniaxial", "planar", "equibiaxial"}, optional
        Which test it was. Otherwise a word in the name of the file or above its numbers tells
        (planar, pure shear, plane strain; biaxial; uniaxial, tensile), and without one it is
        taken as uniaxial, with a remark.
    compression : bool
        Whether the file counts compression as positive: the signs of strain and stress are turned.
    branch : {"loading", "unloading", "mean"}, optional
        What to take of a test with loops, see `ngspring.problem.curves.branches`; loading by
        default.
    specimen : int, optional
        Which one, from 1, if there are several.

    Raises
    ------
    ProblemError
        With the name of the file.

    Examples
    --------
    >>> sheet = ngspring.read_material_test("sheet.csv", "planar")  # doctest: +SKIP
    """
    name = os.fsdecode(path)
    with naming(name):
        text = read_text(name, foreign=True)
        return parse_material_test(
            text,
            test,
            compression=compression,
            branch=branch,
            specimen=specimen,
            name=os.path.basename(name),
        )


def parse_material_test(
    text: str,
    test: str | None = None,
    *,
    compression: bool = False,
    branch: str | None = None,
    specimen: int | None = None,
    name: str = "",
) -> MaterialTest:
    """A test of a material from CSV text, see `read_material_test`."""
    remarks: list[str] = []
    if test is None:
        test = _told(name, text)
        if test is None:
            test = "uniaxial"
            remarks.append(
                "nothing says which test it was: taken as uniaxial (--planar or --equibiaxial say"
                " otherwise)"
            )
    choice("test", test, tuple(MODES))
    columns = parse_columns(text, specimen, header_needed="stretch [-];nominal stress [MPa]")
    if not columns.stress:
        raise ProblemError(
            "the columns are displacement and force: give strain (displacement over gauge length)"
            " and nominal stress (force over original area)"
        )
    strain, stress = columns.x, columns.y
    remarks += columns.remarks
    if compression or (columns.compression and strain.max() > -strain.min()):
        if strain.min() < -_NOISE * abs(strain.max()):
            raise ProblemError(
                "compression turns the signs of a test that counts it as positive, but here strains"
                f" are negative (down to {strain.min():.4g})"
            )
        strain, stress = -strain, -stress
        reason = "--compression" if compression else f"column {shown(columns.compression)}"
        remarks.append(f"{reason}: the signs of strain and stress are turned")
    about_loops: list[str] = []
    strain, stress = single_valued(strain, stress, branch, about_loops)
    if about_loops:
        remarks.append(
            "the test waits, or goes forth and back: one branch is taken,"
            f" {branch or 'loading'}, of several loops the last that is complete"
        )
    return MaterialTest(test, 1.0 + strain, stress, name, tuple(remarks))


def _told(name: str, text: str) -> str | None:
    """Which test a name, or else the lines of words in a text, tell; None if none."""
    words = [line for line in text.splitlines()[:200] if re.search(r"[^\W\d]{3}", line)]
    for place in (name, "\n".join(words)):
        for test, pattern in _WORDS.items():
            if re.search(pattern, place, re.IGNORECASE):
                return test
    return None


def as_tests(given: object) -> tuple[MaterialTest, ...]:
    """One or several tests, each a `MaterialTest` or the path of a file.

    Raises
    ------
    ProblemError
        If there is none.
    """
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    tests = []
    for each in several:
        if isinstance(each, str | os.PathLike):
            each = read_material_test(each)
        if not isinstance(each, MaterialTest):
            raise ProblemError(f"{shown(each)} is neither a MaterialTest nor the path of a file")
        tests.append(each)
    if not tests:
        raise ProblemError("give at least one test of the material")
    return tuple(tests)
