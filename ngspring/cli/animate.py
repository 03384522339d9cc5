"""The command ``ngspring animate``."""

from __future__ import annotations

import os
from importlib.resources import as_file, files
from pathlib import Path

import click

from ngspring.analysis.forward import load_displacement
from ngspring.analysis.states import curve_displacements
from ngspring.basics.errors import DesignFileError
from ngspring.cli.options import MOST_POINTS, OK, Finite, FiniteRange, incomplete, threads_option
from ngspring.design.gallery import gallery
from ngspring.design.snapshots import Snapshots
from ngspring.evolution.folder import DESIGN, SNAPSHOTS, read_design
from ngspring.view.animation import animate_deformation, animate_evolution, check_film

KINDS = ("deformation", "evolution")


@click.command("animate")
@click.argument("name", metavar="DESIGN|RUN")
@click.option(
    "--kind",
    type=click.Choice(KINDS),
    default=KINDS[0],
    show_default=True,
    help="Along the load path, or over the design updates.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Film, .gif or .mp4 (with ffmpeg); beside the design by default, with its name.",
)
@click.option("--from", "low", type=Finite(), help="First displacement d in mm.")
@click.option("--to", "high", type=Finite(), help="Last displacement d in mm.")
@click.option(
    "--points",
    type=click.IntRange(min=2, max=MOST_POINTS),
    default=41,
    show_default=True,
    help="Displacements of the deformation.",
)
@click.option("--fps", type=FiniteRange(min=0.5, max=50), help="States per second.")
@threads_option
def animate_command(
    name: str,
    kind: str,
    out: Path | None,
    low: float | None,
    high: float | None,
    points: int,
    fps: float | None,
    threads: int | None,
) -> int:
    """Film of a design as GIF or MP4.

    The deformation along the load path needs a design: a file, a run folder, or the name of a
    stored one. The evolution needs the snapshots of a run: its folder, a snapshots.npz, or the
    name of a stored design that has them.
    """
    if kind == "evolution":
        if low is not None or high is not None:
            raise click.UsageError("--from and --to belong to --kind deformation")
        snapshots, path = read_snapshots(name)
        film = _film(path, kind) if out is None else out
        animate_evolution(snapshots, film, fps)
        click.echo(f"film: {film}")
        return OK

    design, path = read_design(name)
    film = _film(path, kind) if out is None else out
    displacements = {0.0, *curve_displacements(design, low, high, points)}
    check_film(film)
    # The symmetric path is the same on the full domain, at ten times the cost.
    response = load_displacement(design, displacements, "quarter", threads=threads)
    animate_deformation(design, response, film, 12.0 if fps is None else fps)
    click.echo(f"film: {film}")
    return OK if response.complete else incomplete(response.message)


def _film(path: Path, kind: str) -> Path:
    """Name of a film: in a run folder its kind is enough."""
    stem = kind if path.name in (DESIGN, SNAPSHOTS) else f"{path.stem}-{kind}"
    return path.with_name(f"{stem}.gif")


def read_snapshots(text: str) -> tuple[Snapshots, Path]:
    """Snapshots of a run with the path of their file: a run folder, a file, or a stored name.

    Raises
    ------
    DesignFileError
        If there are none, or they cannot be read.
    """
    path = Path(text)
    if os.path.isdir(path):
        path = path / SNAPSHOTS
        if not os.path.isfile(path):
            raise DesignFileError(f"there are no snapshots of a run in {text}: no {SNAPSHOTS}")
    if path.suffix or path.parent != Path() or os.path.exists(path):
        return Snapshots.load(path), path
    if text not in gallery:
        # The message of a missing design names the nearest one.
        gallery[text]
    stored = files("ngspring.design") / "stored" / f"snapshots-{text}.npz"
    if not stored.is_file():
        raise DesignFileError(f"no snapshots are stored with the design {text!r}")
    with as_file(stored) as found:
        return Snapshots.load(found), Path(f"{text}.npz")
