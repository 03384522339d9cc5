"""Every stored design remodelled as a solid with real contact, beside the third medium's answer.

The verdicts go to examples/results/verification.json, which the results page shows; pictures of
the deformed solids with their contact pressure to examples/figures/contact-NAME.png, and the two
curves to examples/figures/verification-NAME.png. Designs that have not changed since are skipped.
One to a few minutes for each on one core.

    python examples/verification_of_gallery.py [NAME ...] [--threads N]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ngspring import NgspringError, gallery
from ngspring.basics.files import write_text
from ngspring.solid.verification import verify
from ngspring.view.figure import save_figure
from ngspring.view.solid import contact_states_figure, verification_figure

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "verification.json"


def read() -> dict[str, Any]:
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these designs")
    parser.add_argument("--threads", type=int, help="threads to use")
    given = parser.parse_args(arguments)
    for name in given.names or gallery:
        design = gallery[name]
        fingerprint = f"{design.volume:.9e}"
        if read().get(name, {}).get("design") == fingerprint:
            continue
        found: dict[str, Any] = {"design": fingerprint}
        try:
            outcome = verify(design, threads=given.threads)
        except NgspringError as error:
            found["error"] = str(error)
        else:
            found |= outcome.to_dict()
            pictures = HERE / "figures"
            save_figure(verification_figure(outcome), pictures / f"verification-{name}.png")
            save_figure(contact_states_figure(outcome), pictures / f"contact-{name}.png")
        known = read() | {name: found}
        write_text(RESULTS, json.dumps(dict(sorted(known.items())), indent=1) + "\n")
        print(f"{name}: {found.get('error', found.get('largest_deviation'))}", flush=True)
    return read()


if __name__ == "__main__":
    main()
