"""What the scripts of this folder share: their arguments, and where their numbers go."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ngspring.basics.files import write_text

HERE = Path(__file__).parent


def parser(text: str | None) -> argparse.ArgumentParser:
    """--threads and --out, to which a script adds its own."""
    made = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--threads", type=int, default=1, help="threads to use (default: 1)")
    made.add_argument("--out", type=Path, default=HERE, help="folder of results and figures")
    return made


def parsed(
    made: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> tuple[argparse.Namespace, Path, Path]:
    """The arguments, and the folders of results and figures, which are made."""
    given = made.parse_args(arguments)
    results, figures = given.out / "results", given.out / "figures"
    for folder in (results, figures):
        folder.mkdir(parents=True, exist_ok=True)
    return given, results, figures


def write_numbers(path: Path, known: Mapping[str, Any]) -> None:
    """Write what a script has found."""
    write_text(path, json.dumps(known, indent=1) + "\n")
