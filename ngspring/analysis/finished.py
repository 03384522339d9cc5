"""The responses of a finished design: stored or computed, which is decided here alone."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from importlib.resources import as_file
from pathlib import Path

from ngspring.analysis.response import Response
from ngspring.analysis.states import States, curve_displacements, index_of
from ngspring.analysis.stored import StoredResponse, StoredStates
from ngspring.basics.errors import DesignFileError
from ngspring.design.design import Design
from ngspring.design.gallery import gallery, parts

logger = logging.getLogger(__name__)

#: Name of the file in a run folder, beside the design's.
STATES_FILE = "states.npz"

Stored = Mapping[float, StoredResponse]


def responses_of(
    design: Design, folder: Path | None = None, threads: int | None = None
) -> Mapping[float, States]:
    """Responses of a design by eta, at its `curve_displacements` and at its control points.

    They are those that are stored in its folder or with the gallery; else they are computed.

    Parameters
    ----------
    design : Design
    folder : path, optional
        Of the design's file.
    threads : int, optional
        See `ngspring.optimize`.
    """
    stored = stored_responses(design, folder)
    return computed_responses(design, threads) if stored is None else stored


def curve_of(
    design: Design,
    displacements: Sequence[float],
    folder: Path | None = None,
    threads: int | None = None,
) -> States:
    """The response of a design at displacements in mm, in their order.

    Stored, where all of them are among the stored ones; else computed.

    Parameters
    ----------
    design : Design
    displacements : sequence of float
    folder : path, optional
        Of the design's file.
    threads : int, optional
        See `ngspring.optimize`.
    """
    stored = stored_responses(design, folder)
    curve = None if stored is None else stored[0.0]
    if curve is not None and curve.complete:
        places = [index_of(curve, d) for d in displacements]
        found = [place for place in places if place is not None]
        if len(found) == len(places):
            return curve.selected(found)
    from ngspring.analysis.forward import load_displacement

    return load_displacement(design, displacements, threads=threads)


def computed_responses(design: Design, threads: int | None = None) -> dict[float, Response]:
    """What `responses_of` computes."""
    # NGSolve takes a while to import: what is stored is shown without it.
    from ngspring.analysis.forward import control_point_responses

    # The symmetric path is the same on the full domain, at ten times the cost.
    return control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )


def stored_responses(design: Design, folder: Path | None = None) -> Stored | None:
    """Those of a design that are stored in its folder or with the gallery; None without any."""
    found = None if folder is None else responses_in(folder, design)
    return responses_in_gallery(design) if found is None else found


def responses_in(folder: Path, design: Design) -> Stored | None:
    """Those of a design that are stored in a folder; None without any."""
    path = folder / STATES_FILE
    return _read(path, design) if os.path.isfile(path) else None


def responses_in_gallery(design: Design) -> Stored | None:
    """Those of a design that are stored with the gallery; None without any."""
    name = design.problem.name
    for resource in (*gallery.states(name), *parts.states(name)):
        with as_file(resource) as path:
            stored = _read(path, design)
        if stored is not None:
            return stored
    return None


def _read(path: Path, design: Design) -> Stored | None:
    """The responses in a file, if it can be read and they are those of this design."""
    try:
        stored = StoredStates.load(path)
    except DesignFileError as error:
        logger.warning("%s: what it holds is computed again", error)
        return None
    if not stored.belong_to(design):
        logger.info("%s holds the states of another design", path)
        return None
    logger.info("states from %s", path)
    return stored.responses
