"""Store the parts of a campaign with the package: ngspring.parts, see parts.toml.

Only those whose solids go through their targets are taken. Their load paths are stored beside them,
so that `ngspring show C4-part`, reports and figures need not compute them.

    python examples/paper/store_parts.py FOLDER [--threads N]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib.resources import as_file
from pathlib import Path

from ngspring import Design, parts
from ngspring.analysis.finished import computed_responses, responses_in
from ngspring.analysis.stored import StoredStates
from ngspring.basics.errors import DesignFileError
from ngspring.design.gallery import STATES
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import DESIGN
from ngspring.part.realisation import is_settled


def store(folder: Path, threads: int | None) -> str:
    """Store the part in a run folder; what there is to say about it."""
    try:
        part = Design.load(folder / DESIGN)
    except DesignFileError as error:
        return str(error)
    if not is_settled(part):
        return "not finished"
    if reason := flaw(part):
        return reason
    responses = responses_in(folder, part) or computed_responses(part, threads)
    with as_file(parts.folder) as target:
        part.save(target / f"{folder.name}.npz")
        StoredStates.of(part, responses).save(target / f"{STATES}{folder.name}.npz")
    return "stored"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of the campaign")
    parser.add_argument("--threads", type=int, default=1, help="threads to use (default: 1)")
    given = parser.parse_args(arguments)
    for folder in sorted(path for path in given.folder.iterdir() if path.is_dir()):
        print(f"{folder.name}: {store(folder, given.threads)}", flush=True)


if __name__ == "__main__":
    main()
