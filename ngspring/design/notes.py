"""The notes that travel with a design: how it came about, as far as ngspring itself reads them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ngspring.basics.arrays import LARGEST
from ngspring.basics.checks import finite_number, printable, refused
from ngspring.design.corrections import CORRECTIONS, MISSED, checked_corrections

#: Notes that are text, and how many characters they may have.
_TEXTS, LONGEST_NOTE = ("start", "failed", "stopped", "ngsolve", MISSED), 300


def checked_notes(info: object, points: int) -> dict[str, Any]:
    """Notes of a design with ``points`` control points; texts are made printable.

    ``start``, ``failed``, ``stopped``, ``missed`` and ``ngsolve`` are texts, ``converged`` a truth
    value, ``falling_directions`` an integer, ``q`` a force for each control point, ``grey`` shares
    of the strain energy, and ``corrections`` see `ngspring.design.corrections`. Others are the
    user's own.

    Raises
    ------
    ProblemError
        If one is something else.
    """
    if not isinstance(info, Mapping):
        raise refused("info", info, "a table of notes")
    notes = dict(info)
    for name in _TEXTS:
        if name in notes:
            if not isinstance(notes[name], str):
                raise refused(f"the note {name}", notes[name], "text")
            notes[name] = printable(notes[name], LONGEST_NOTE)
    for name, kind in (("converged", bool), ("falling_directions", int)):
        if name in notes and not isinstance(notes[name], kind):
            raise refused(f"the note {name}", notes[name], f"of type {kind.__name__}")
    if "q" in notes:
        q = notes["q"]
        if not isinstance(q, list | tuple) or len(q) != points:
            raise refused("the note q", q, f"{points} forces, one for each control point")
        notes["q"] = [finite_number("the note q", force) for force in q]
        if max(map(abs, notes["q"])) > LARGEST:
            raise refused("the note q", q, "forces that can be computed with")
    if "grey" in notes:
        if not isinstance(notes["grey"], list | tuple):
            raise refused("the note grey", notes["grey"], "a list of shares of the strain energy")
        notes["grey"] = [finite_number("the note grey", share) for share in notes["grey"]]
    if CORRECTIONS in notes:
        notes[CORRECTIONS] = checked_corrections(notes[CORRECTIONS], points)
    return notes
