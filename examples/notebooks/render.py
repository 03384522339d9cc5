"""Execute the notebooks' scripts and write the .ipynb files beside them.

The scripts (jupytext, percent format) are what is edited; the .ipynb files are made from them, so
that a repository viewer shows text, numbers and pictures.

    python examples/notebooks/render.py [NAME ...]

A name is a part of a script's name, such as 03. Needs ``pip install '.[notebooks]'``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent
#: Seconds for a whole notebook, on a busy machine.
LONGEST = 600
#: A displayed scene carries all its points; above this size it is left out of the stored file.
LARGEST_SCENE = 600_000


def scripts(names: list[str] | None = None) -> list[Path]:
    """The notebooks' scripts whose names contain one of these, all by default."""
    found = sorted(FOLDER.glob("[0-9][0-9]_*.py"))
    return [path for path in found if not names or any(name in path.stem for name in names)]


def execute(script: Path, extra: str = "", longest: int = LONGEST) -> nbformat.NotebookNode:
    """Run a script as a notebook in a fresh kernel and return it with its outputs.

    Parameters
    ----------
    script : Path
    extra : str
        Code to run at the end, in a cell of its own.
    longest : int
        Seconds after which the notebook is given up.
    """
    notebook = jupytext.read(script)
    if extra:
        notebook.cells.append(nbformat.v4.new_code_cell(extra))
    end = time.monotonic() + longest
    client = NotebookClient(
        notebook,
        timeout_func=lambda cell: max(1, round(end - time.monotonic())),
        kernel_name="python3",
        coalesce_streams=True,
        resources={"metadata": {"path": str(FOLDER)}},
    )
    return client.execute()


def _without_large_scenes(notebook: nbformat.NotebookNode) -> None:
    """Drop the states of scenes that are too large for a repository, and what only times."""
    states = notebook.metadata.get("widgets", {})
    for bundle in states.values():
        models = bundle.get("state", {})
        for key in [k for k, v in models.items() if len(str(v)) > LARGEST_SCENE]:
            del models[key]
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)


def render(script: Path) -> Path:
    """Write the executed notebook beside its script."""
    notebook = execute(script)
    _without_large_scenes(notebook)
    for k, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{k:02d}"
    path = script.with_suffix(".ipynb")
    nbformat.write(notebook, path)
    return path


if __name__ == "__main__":
    for script in scripts(sys.argv[1:]):
        path = render(script)
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB", flush=True)
