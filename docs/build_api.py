"""The API pages, made from the docstrings with pdoc (extra ``docs``).

    python docs/build_api.py [FOLDER]     (default: build/api; open index.html)

Every module of the package gets a page; a docstring that pdoc cannot render, or an annotation
that it cannot resolve, is an error.
"""

from __future__ import annotations

import pkgutil
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import pdoc

import ngspring


def package_names() -> list[str]:
    """The package and the packages in it; pdoc finds their modules."""
    found = pkgutil.iter_modules(ngspring.__path__, "ngspring.")
    return ["ngspring", *(module.name for module in found if module.ispkg)]


def build(folder: Path) -> Path:
    """Write the pages and return the first one."""
    pdoc.render.configure(
        docformat="numpy", math=True, footer_text=f"ngspring {ngspring.__version__}"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        pdoc.pdoc(*package_names(), output_directory=folder)
    return folder / "index.html"


def main(arguments: Sequence[str]) -> None:
    """Build into the folder that is named, and say where to start reading."""
    print(build(Path(arguments[0] if arguments else "build/api")))


if __name__ == "__main__":
    main(sys.argv[1:])
