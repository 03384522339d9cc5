"""Moving pictures: how a design evolved, and how it deforms along its load path.

GIF needs nothing but matplotlib and Pillow; MP4 is written by ffmpeg, if that is installed.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ngspring.analysis.response import Response
from ngspring.analysis.states import full_displacement
from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import NgspringError
from ngspring.basics.files import PathLike, replacing
from ngspring.basics.text import significant
from ngspring.design.design import Design
from ngspring.design.snapshots import Snapshots
from ngspring.problem.spring import SpringProblem
from ngspring.view.curves import draw_curve
from ngspring.view.design import draw_design, draw_guides
from ngspring.view.figure import new_figure
from ngspring.view.text import width_symbol

SUFFIXES = (".gif", ".mp4")
#: More frames than this make large files and no better film; the grey designs at the beginning
#: of an evolution take the most space.
MOST_FRAMES = 120
MOST_SNAPSHOTS = 60
_DPI = 100
_HEIGHT = 3.6
_CURVE_WIDTH = 3.4
_SECONDS_AT_END = 1.5


def check_film(path: PathLike) -> None:
    """See that a film can be written under this name here, before it is computed.

    Raises
    ------
    NgspringError
        If the suffix is neither .gif nor .mp4, or .mp4 and there is no ffmpeg.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise NgspringError(f"{path}: the suffix of a film must be .gif or .mp4")
    if suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise NgspringError(
            f"{path}: an MP4 film needs the program ffmpeg, which is not found here; a .gif works"
            " without it"
        )


def animate_evolution(snapshots: Snapshots, path: PathLike, fps: float | None = None) -> None:
    """Write the way of a design through its evolution, beside its width over the updates.

    Parameters
    ----------
    snapshots : Snapshots
        Of at least two design updates; of very many, evenly spaced ones are shown.
    path : path
        A .gif or .mp4 file, which is replaced as a whole.
    fps : float, optional
        Snapshots per second; by default 8, and fewer if the film would take less than 6 seconds.

    Raises
    ------
    NgspringError
        If there are too few snapshots, or the film cannot be written here (see `check_film`).
    RunFolderError
        If the file cannot be written.
    """
    check_film(path)
    if len(snapshots.updates) < 2:
        raise NgspringError("an animation of the evolution needs at least two snapshots")
    chosen = _thinned(np.arange(len(snapshots.updates)), MOST_SNAPSHOTS)
    kept = Snapshots(
        snapshots.problem, snapshots.updates[chosen], snapshots.coefficients[chosen]
    ).designs()
    problem = snapshots.problem
    updates, designs = list(kept), list(kept.values())
    widths = [design.relative_width for design in designs]
    figure, state, diagram = _two_axes(problem.L / problem.H)
    symbol = width_symbol(problem)
    diagram.plot(updates, widths, color="black", linewidth=1.2, marker=".", markersize=3)
    diagram.set_xlabel("design update")
    diagram.set_ylabel(f"V as {symbol}")
    diagram.xaxis.set_major_locator(MaxNLocator(integer=True))
    diagram.grid(color="0.92")
    (marker,) = diagram.plot([], [], "o", color="black", markerfacecolor="0.6", markersize=9)

    def draw(k: int) -> None:
        state.clear()
        draw_design(state, designs[k])
        _finish(state, problem, (0.0, problem.L), (0.0, problem.H), 0.0)
        state.set_title(f"update {updates[k]}: {symbol} = {widths[k]:.4f}", fontsize=10)
        marker.set_data([updates[k]], [widths[k]])

    fps = min(8.0, len(designs) / 6) if fps is None else fps
    rest = [len(designs) - 1] * max(1, round(_SECONDS_AT_END * fps))
    _write(figure, path, draw, [*range(len(designs)), *rest], fps)


def animate_deformation(
    design: Design, response: Response, path: PathLike, fps: float = 12.0
) -> None:
    """Write the deformation along the load path, beside the curve with a marker.

    From rest to the largest tension, back, to the largest compression, and back.

    Parameters
    ----------
    design : Design
    response : Response
        Of this design; the more points, the smoother the film.
    path : path
        A .gif or .mp4 file, which is replaced as a whole.
    fps : float
        Points of the response per second.

    Raises
    ------
    NgspringError
        If there is but one point, or the film cannot be written here (see `check_film`).
    RunFolderError
        If the file cannot be written.
    """
    check_film(path)
    response = response.by_displacement()
    if len(response.d) < 2:
        raise NgspringError("an animation of the deformation needs at least two displacements")
    problem = design.problem
    fields = [full_displacement(response, k) for k in range(len(response.d))]
    across = _extent(design, fields)
    upward = 0.0, problem.H + max(0.0, float(response.d.max()))
    figure, state, diagram = _two_axes((across[1] - across[0]) / (upward[1] - upward[0]))
    draw_curve(diagram, {"response": response}, problem)
    (marker,) = diagram.plot(
        [], [], "D", color="black", markerfacecolor="white", markersize=8, zorder=5
    )

    largest = float(np.abs(response.q).max())

    def draw(k: int) -> None:
        d, q = float(response.d[k]), float(response.q[k])
        state.clear()
        draw_design(state, design, fields[k])
        _finish(state, problem, across, upward, d)
        place, force = significant(d, 3, among=problem.H), significant(q, 3, among=largest)
        state.set_title(f"d = {place} mm, q = {force} N", fontsize=10)
        marker.set_data([d], [q])

    _write(figure, path, draw, _there_and_back(response.d), fps)


def _there_and_back(d: FloatArray) -> list[int]:
    """Numbers of the points from rest to the largest d, to the smallest one, and to rest."""
    rest = int(np.abs(d).argmin())
    up, down = (
        _thinned(np.array(way), MOST_FRAMES // 4).tolist()
        for way in (range(rest, len(d)), range(rest, -1, -1))
    )
    return [*up, *up[-2::-1], *down[1:], *down[-2::-1]]


def _thinned(numbers: IntArray, count: int) -> IntArray:
    """At most so many of the numbers, evenly spaced, with the first and the last one."""
    count = min(len(numbers), count)
    return np.asarray(numbers[np.linspace(0, len(numbers) - 1, count).round().astype(int)])


def _extent(design: Design, fields: Sequence[FloatArray]) -> tuple[float, float]:
    """The largest extent of the solid in x in mm, over all displacement fields."""
    problem = design.problem
    x = np.linspace(0, problem.L, fields[0].shape[1])
    y = np.linspace(0, problem.H, fields[0].shape[2])
    solid = design.density(x[:, None], y[None, :]) > 0.5
    place = [x[:, None] + u[0] for u in fields]
    left = min((float(p[solid].min()) for p in place if solid.any()), default=0.0)
    right = max((float(p[solid].max()) for p in place if solid.any()), default=problem.L)
    return min(0.0, left), max(problem.L, right)


def _two_axes(shape: float) -> tuple[Figure, Axes, Axes]:
    """Axes for a state (of this width over its height) and, at its right, for a diagram."""
    below, above, left, gap = 0.55, 0.4, 0.6, 0.75
    high = _HEIGHT - below - above
    wide = min(high * shape * 1.06, 5.0)
    # Video formats want an even number of pixels.
    total = round((left + wide + gap + _CURVE_WIDTH + 0.15) * _DPI / 2) * 2 / _DPI
    figure = new_figure(total, _HEIGHT, constrained=False)
    place = (left / total, below / _HEIGHT, wide / total, high / _HEIGHT)
    state = figure.add_axes(place)
    beside = ((left + wide + gap) / total, place[1], _CURVE_WIDTH / total, place[3])
    return figure, state, figure.add_axes(beside)


def _finish(
    axes: Axes,
    problem: SpringProblem,
    across: tuple[float, float],
    upward: tuple[float, float],
    d: float,
) -> None:
    """The same limits and lines in every frame: the sides that are held, and the axis."""
    draw_guides(axes, problem, d)
    for low, high, limit in ((*across, axes.set_xlim), (*upward, axes.set_ylim)):
        margin = 0.03 * (high - low)
        limit(low - margin, high + margin)
    axes.set_aspect("equal")
    axes.set_xticks([0, problem.L / 2, problem.L])
    axes.set_yticks([0, problem.H / 2, problem.H])
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    for side in axes.spines.values():
        side.set_visible(False)


def _write(
    figure: Figure, path: PathLike, draw: Callable[[int], None], frames: Sequence[int], fps: float
) -> None:
    """Draw frames and write them as one film, atomically."""
    is_gif = Path(path).suffix.lower() == ".gif"
    writer: AbstractMovieWriter = PillowWriter(fps=fps) if is_gif else FFMpegWriter(fps=fps)  # type: ignore[arg-type]
    with replacing(path) as temporary:
        writer.setup(figure, str(temporary), _DPI)
        shown = None
        for frame in frames:
            if frame != shown:
                draw(frame)
            shown = frame
            writer.grab_frame()
        try:
            writer.finish()
        except subprocess.CalledProcessError as error:
            raise NgspringError(
                f"{path}: ffmpeg cannot write it (code {error.returncode})"
            ) from None
