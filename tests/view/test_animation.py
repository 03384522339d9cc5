"""Films show every state at the same place and scale, in a file of moderate size."""

from __future__ import annotations

import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from support.commands import invoke

from ngspring import (
    ControlPoint,
    Design,
    NgspringError,
    Response,
    RunFolderError,
    SpringProblem,
    load_displacement,
    optimize,
)
from ngspring.basics.arrays import FloatArray
from ngspring.design.snapshots import Snapshots
from ngspring.view.animation import animate_deformation, animate_evolution, check_film

PROBLEM = SpringProblem(
    (ControlPoint(10.0, 2.0), ControlPoint(-10.0, -2.0)), name="small", elements=8, l_i=10.0
)
LARGEST = 2e6


def frames(path: Path) -> list[FloatArray]:
    """Brightness of the frames of a GIF."""
    with Image.open(path) as film:
        return [np.asarray(frame.convert("L"), float) for frame in ImageSequence.Iterator(film)]


def seconds(path: Path) -> float:
    """How long a GIF takes."""
    with Image.open(path) as film:
        return sum(frame.info["duration"] for frame in ImageSequence.Iterator(film)) / 1000


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.column(PROBLEM)


@pytest.fixture(scope="module")
def response(design: Design) -> Response:
    return load_displacement(design, [-10.0, -5.0, 0.0, 5.0, 10.0], threads=1)


@pytest.fixture
def snapshots(design: Design) -> Snapshots:
    """The hole of a column becomes larger."""
    sizes = np.linspace(1.0, 3.0, 6)
    coefficients = np.array([size * design.coefficients for size in sizes], np.float16)
    return Snapshots(PROBLEM, np.arange(0, 60, 10), coefficients)


@pytest.mark.long
def test_the_deformation_goes_there_and_back(
    design: Design, response: Response, tmp_path: Path
) -> None:
    path = tmp_path / "film.gif"
    animate_deformation(design, response, path)
    film = frames(path)
    # Rest, tension and back, compression and back.
    assert len(film) == 9
    for there, back in ((0, 4), (1, 3), (5, 7), (0, 8)):
        assert np.abs(film[there] - film[back]).mean() < 0.5
    assert all(np.abs(a - b).mean() > 0.5 for a, b in pairwise(film))
    assert path.stat().st_size < LARGEST
    assert seconds(path) == pytest.approx(9 / 12, rel=0.1)


def state_part(frame: FloatArray) -> FloatArray:
    """The part of a frame with the spring, without the title and the diagram."""
    height = frame.shape[0]
    return frame[int(0.12 * height) : int(0.84 * height), 70 : frame.shape[1] - 440]


def test_the_spring_stays_at_its_place_and_its_top_follows_d(
    design: Design, response: Response, tmp_path: Path
) -> None:
    path = tmp_path / "film.gif"
    animate_deformation(design, response, path)
    tops, bottoms = [], []
    for frame in frames(path):
        # In the column's left edge, where nothing but the lines of the held sides is dark.
        dark = np.flatnonzero((state_part(frame)[:, :12] < 120).all(axis=1))
        tops.append(dark.min())
        bottoms.append(dark.max())
    assert len(set(bottoms)) == 1
    rest = tops[0]
    rise = np.array([rest - top for top in tops])
    scale = (bottoms[0] - rest) / PROBLEM.H
    expected = scale * np.array([0, 5, 10, 5, 0, -5, -10, -5, 0])
    np.testing.assert_allclose(rise, expected, atol=2.5)


def test_the_evolution_has_a_frame_for_each_snapshot(snapshots: Snapshots, tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    animate_evolution(snapshots, path)
    film = frames(path)
    assert len(film) == len(snapshots.updates)
    assert all(np.abs(a - b).mean() > 0.2 for a, b in pairwise(film))
    # The solid becomes darker while its diagram beside changes only by its marker.
    first, last = state_part(film[0]), state_part(film[-1])
    assert (last < 60).sum() > 1.2 * (first < 60).sum()
    assert path.stat().st_size < LARGEST
    assert seconds(path) > 6


@pytest.mark.long
def test_a_long_evolution_shows_the_first_and_the_last_design(
    design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most, count = 9, 30
    monkeypatch.setattr("ngspring.view.animation.MOST_SNAPSHOTS", most)
    coefficients = np.array([design.coefficients] * count, np.float16)
    coefficients[0] += 1
    coefficients[-1] -= 1
    path = tmp_path / "film.gif"
    animate_evolution(Snapshots(PROBLEM, np.arange(count), coefficients), path, fps=2.0)
    film = frames(path)
    assert len(film) <= most
    assert state_part(film[0]).mean() < state_part(film[1]).mean() < state_part(film[-1]).mean()


@pytest.mark.long
def test_a_fine_curve_is_thinned_but_not_at_its_ends(
    design: Design, response: Response, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ngspring.view.animation.MOST_FRAMES", 8)
    path, whole = tmp_path / "film.gif", tmp_path / "whole.gif"
    animate_deformation(design, response, path)
    monkeypatch.undo()
    animate_deformation(design, response, whole)
    film, every = frames(path), frames(whole)
    # Rest, largest tension, rest, largest compression, rest.
    assert len(film) == 5
    for frame, same in zip(film, every[::2], strict=True):
        assert np.abs(frame - same).mean() < 0.5


def test_a_film_that_cannot_be_written_leaves_the_old_one(
    design: Design, response: Response, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "film.gif"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("ngspring.view.animation.draw_design", fail)
    with pytest.raises(RunFolderError, match="no space left"):
        animate_deformation(design, response, path)
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]


@pytest.mark.parametrize("name", ["film.png", "film", "film.gif.txt"])
def test_a_film_must_be_gif_or_mp4(name: str) -> None:
    with pytest.raises(NgspringError, match=r"must be \.gif or \.mp4"):
        check_film(name)


def test_mp4_without_ffmpeg_is_refused_and_gif_recommended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ngspring.view.animation.FFMpegWriter.isAvailable", lambda: False)
    with pytest.raises(NgspringError, match=r"needs the program ffmpeg.*a \.gif works"):
        check_film("film.mp4")
    check_film("film.gif")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_mp4_is_written_by_ffmpeg(design: Design, response: Response, tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    animate_deformation(design, response, path)
    assert path.stat().st_size < LARGEST
    probe = ["ffmpeg", "-i", str(path), "-f", "null", "-"]
    told = subprocess.run(probe, capture_output=True, text=True, check=True).stderr
    assert "yuv420p" in told
    assert "frame=    9" in told


def test_too_little_to_animate_is_an_error(
    design: Design, snapshots: Snapshots, tmp_path: Path
) -> None:
    path = tmp_path / "film.gif"
    with pytest.raises(NgspringError, match="at least two snapshots"):
        animate_evolution(snapshots.select([]), path)
    rest = load_displacement(design, [0.0], threads=1)
    with pytest.raises(NgspringError, match="at least two displacements"):
        animate_deformation(design, rest, path)
    assert not list(tmp_path.iterdir())


# -- ngspring animate ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    optimize(PROBLEM, max_updates=3, out=folder, threads=1)
    return folder


@pytest.mark.long
def test_a_run_folder_gets_both_films(run: Path) -> None:
    result = invoke("animate", run, "--points", 3, "--threads", 1)
    assert result.stdout == f"film: {run / 'deformation.gif'}\n"
    assert len(frames(run / "deformation.gif")) == 5
    result = invoke("animate", run, "--kind", "evolution")
    assert result.stdout == f"film: {run / 'evolution.gif'}\n"
    assert len(frames(run / "evolution.gif")) == 4


def test_the_stored_evolution_of_c7_has_a_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("animate", "C7", "--kind", "evolution").stdout == "film: C7-evolution.gif\n"
    assert (tmp_path / "C7-evolution.gif").stat().st_size < LARGEST


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("C7", "--out", "x.png"), "must be .gif or .mp4"),
        (("C77",), "there is no stored design 'C77'"),
        (("C4", "--kind", "evolution"), "no snapshots are stored with the design 'C4'"),
        (("C77", "--kind", "evolution"), "there is no stored design 'C77'"),
        ((".", "--kind", "evolution"), "there are no snapshots of a run in ."),
        (("x.npz", "--kind", "evolution"), "there is no file x.npz"),
        (("C7", "--kind", "evolution", "--from", "1"), "--from and --to belong to"),
        (("C7", "--to", "nan"), "'nan' is not a finite number"),
        (("C7", "--kind", "dance"), "'dance' is not one of"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke("animate", *arguments, code=2)
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())
