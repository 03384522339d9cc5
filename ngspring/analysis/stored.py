"""The load path of a finished design in one small file, so that it is not computed again.

What a picture needs: the numbers of every point, and the displacement fields of the control points
with 16 bits, which is a fifth of a micrometre if a spring of 100 mm is pressed by 20 mm. Their
differences from node to node compress to about 20 kB on 80 x 80 elements.

The file says which design it belongs to, by all of its problem but the name and by a digest of its
coefficients. Another design's is never taken for its own.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngspring.analysis.path import Jump
from ngspring.analysis.response import Response
from ngspring.analysis.states import control_places
from ngspring.basics.arrays import LARGEST, FloatArray
from ngspring.basics.checks import printable
from ngspring.basics.files import TEXT, Part, PathLike, reading_arrays, write_arrays
from ngspring.design.design import Design
from ngspring.design.notes import LONGEST_NOTE
from ngspring.problem.spring import SpringProblem

VERSION = 1
#: What is stored of every point.
_NUMBERS = ("d", "q", "energy", "stiffness", "grey")
_PARTS = {
    "problem": TEXT,
    "coefficients": TEXT,
    "domain": TEXT,
    "eta": Part("f", 1),
    "points": Part("i", 1),
    "iterations": Part("i", 1),
    "messages": Part("U", 1),
    **dict.fromkeys(_NUMBERS, Part("f", 1)),
    "jumps": Part("f", 2),
    "places": Part("i", 1),
    "sizes": Part("f", 1),
    "u": Part("i", 4),
}
#: The largest component of a field is this many steps.
_STEPS = 32767


@dataclass(frozen=True, eq=False)
class StoredResponse:
    """What is stored of a `ngspring.Response`, by the same names, in increasing order of d.

    Attributes
    ----------
    nodes_u : mapping from int to array (2, 2 nx + 1, 2 ny + 1)
        Displacements in mm of the points at control points alone, by their place in the curve, to
        1/65534 of the largest component.
    """

    problem: SpringProblem
    d: FloatArray
    q: FloatArray
    energy: FloatArray
    stiffness: FloatArray
    grey: FloatArray
    nodes_u: Mapping[int, FloatArray]
    message: str = ""
    iterations: int = 0
    jumps: tuple[Jump, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether every displacement that was asked for was reached."""
        return not self.message

    def selected(self, places: Sequence[int]) -> StoredResponse:
        """The same with these of its points only, in this order."""
        k = np.asarray(places, dtype=int)
        numbers = {name: getattr(self, name)[k] for name in _NUMBERS}
        fields = {
            new: self.nodes_u[old] for new, old in enumerate(map(int, k)) if old in self.nodes_u
        }
        return dataclasses.replace(self, nodes_u=fields, **numbers)


@dataclass(frozen=True, eq=False)
class StoredStates:
    """Responses of one design, by the offset eta of chi.

    Attributes
    ----------
    problem : SpringProblem
        Of the design.
    coefficients : str
        SHA-256 digest of the design's coefficients.
    responses : mapping from float to StoredResponse
    """

    problem: SpringProblem
    coefficients: str
    responses: Mapping[float, StoredResponse]

    @classmethod
    def of(cls, design: Design, responses: Mapping[float, Response]) -> StoredStates:
        """What is stored of the responses of a design.

        Parameters
        ----------
        design : Design
        responses : mapping from float to Response
            See `ngspring.analysis.forward.control_point_responses`.
        """
        kept = {eta: _kept(r.by_displacement(), design, eta) for eta, r in responses.items()}
        return cls(design.problem, digest(design), kept)

    def belong_to(self, design: Design) -> bool:
        """Whether these are the responses of a design, whatever its name."""
        same = self.problem.equals_but_for_name(design.problem)
        return same and self.coefficients == digest(design)

    def save(self, path: PathLike) -> None:
        """Write one small .npz, atomically.

        Raises
        ------
        RunFolderError
            If it cannot be written.
        """
        write_arrays(
            path,
            {
                "format": "ngspring-states",
                "version": VERSION,
                "problem": self.problem.to_toml(),
                "coefficients": self.coefficients,
                "domain": next(iter(self.responses.values())).problem.domain,
                **_arrays(self.responses),
            },
        )

    @classmethod
    def load(cls, path: PathLike) -> StoredStates:
        """Read what `save` wrote.

        Raises
        ------
        DesignFileError
            If the file is missing, truncated, of another version, or holds no states.
        """
        with reading_arrays(path, "states", VERSION, _PARTS) as parts:
            problem = SpringProblem.parse_toml(parts["problem"])
            analysed = problem.replace(domain=parts["domain"])
            _check(parts, analysed)
            responses = dict(_responses(parts, analysed))
            for eta, response in responses.items():
                if not set(control_places(response, problem, eta)) <= set(response.nodes_u):
                    raise ValueError("the displacements of a control point are missing")
            return cls(problem, parts["coefficients"], responses)


def digest(design: Design) -> str:
    """What tells the coefficients of one design from those of any other."""
    return hashlib.sha256(design.coefficients.astype("<f8").tobytes()).hexdigest()


def _kept(response: Response, design: Design, eta: float) -> StoredResponse:
    places = control_places(response, design.problem, eta)
    return StoredResponse(
        response.problem,
        response.d,
        response.q,
        response.energy,
        response.stiffness,
        response.grey,
        {place: response.nodes_u[place] for place in places},
        response.message,
        response.iterations,
        response.jumps,
    )


# -- arrays ----------------------------------------------------------------------------------------


def _arrays(responses: Mapping[float, StoredResponse]) -> dict[str, Any]:
    """All responses one behind the other; the places of fields count through all of them."""
    kept = list(responses.values())
    first = np.cumsum([0, *(len(r.d) for r in kept)])
    jumps = [(k, j.d, j.q_before, j.q_after) for k, r in enumerate(kept) for j in r.jumps]
    fields = [(first[k] + place, u) for k, r in enumerate(kept) for place, u in r.nodes_u.items()]
    packed = [_packed(u) for _, u in fields]
    nodes = _nodes(kept[0].problem)
    return {
        "eta": np.array(list(responses), float),
        "points": np.diff(first),
        "iterations": np.array([r.iterations for r in kept], np.int64),
        "messages": np.array([r.message for r in kept]),
        **{name: np.concatenate([getattr(r, name) for r in kept]) for name in _NUMBERS},
        "jumps": np.array(jumps, float).reshape(-1, 4),
        "places": np.array([place for place, _ in fields], np.int64),
        "sizes": np.array([size for _, size in packed], float),
        "u": np.array([steps for steps, _ in packed], np.int16).reshape(-1, *nodes),
    }


def _responses(
    parts: Mapping[str, Any], problem: SpringProblem
) -> Iterator[tuple[float, StoredResponse]]:
    """The responses that `_arrays` put one behind the other."""
    fields = list(zip(parts["places"], parts["u"], parts["sizes"], strict=True))
    ends = np.cumsum(parts["points"])
    for k, (begin, end) in enumerate(zip(ends - parts["points"], ends, strict=True)):
        d, q, energy, stiffness, grey = (parts[name][begin:end] for name in _NUMBERS)
        nodes_u = {int(p - begin): _unpacked(u, s) for p, u, s in fields if begin <= p < end}
        jumps = tuple(Jump(*map(float, row[1:])) for row in parts["jumps"] if row[0] == k)
        message = printable(str(parts["messages"][k]), LONGEST_NOTE)
        iterations = int(parts["iterations"][k])
        eta = float(parts["eta"][k])
        yield (
            eta,
            StoredResponse(
                problem, d, q, energy, stiffness, grey, nodes_u, message, iterations, jumps
            ),
        )


def _check(parts: Mapping[str, Any], problem: SpringProblem) -> None:
    """Raise a ValueError if the arrays of a file do not fit together or are no numbers."""
    points, places = parts["points"], parts["places"]
    count = len(points)
    numbers = [parts[name] for name in (*_NUMBERS, "eta", "jumps", "sizes")]
    if not all((np.abs(array) < LARGEST).all() for array in numbers):
        raise ValueError("its numbers must be finite")
    if any(len(parts[name]) != count for name in ("eta", "iterations", "messages")):
        raise ValueError("its lists of responses differ in length")
    if len(set(parts["eta"])) != count or 0.0 not in parts["eta"]:
        raise ValueError("its offsets eta must differ, and 0 be among them")
    if (points < 0).any() or any(len(parts[name]) != sum(points) for name in _NUMBERS):
        raise ValueError("its lists of points differ in length")
    if any((np.diff(d) <= 0).any() for d in np.split(parts["d"], np.cumsum(points)[:-1])):
        raise ValueError("its displacements do not increase")
    if parts["jumps"].shape[1] != 4 or parts["u"].shape != (len(places), *_nodes(problem)):
        raise ValueError("its displacement fields have another mesh than its problem")
    if len(parts["sizes"]) != len(places) or not np.isin(places, np.arange(sum(points))).all():
        raise ValueError("its displacement fields belong to no points")


# -- fields ----------------------------------------------------------------------------------------


def _nodes(problem: SpringProblem) -> tuple[int, int, int]:
    """Shape of a displacement field."""
    nx, ny = problem.sector.cells(problem.elements)
    return 2, 2 * nx + 1, 2 * ny + 1


def _packed(u: FloatArray) -> tuple[NDArray[np.int16], float]:
    """A field as differences of whole steps from node to node, and its largest component."""
    size = float(np.abs(u).max())
    steps = np.rint(u * (_STEPS / (size or 1.0))).astype(np.int16).view(np.uint16)
    # Unsigned numbers overflow by definition, and sums undo it.
    for axis in (1, 2):
        steps = np.diff(steps, axis=axis, prepend=np.uint16(0))
    return steps.view(np.int16), size


def _unpacked(differences: NDArray[Any], size: float) -> FloatArray:
    """The field that `_packed` has taken differences of."""
    steps = differences.astype(np.int16).view(np.uint16)
    for axis in (2, 1):
        steps = np.cumsum(steps, axis=axis, dtype=np.uint16)
    return np.asarray(steps.view(np.int16) * (float(size) / _STEPS))
