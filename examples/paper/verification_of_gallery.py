"""Every stored design remodelled as a solid with real contact, beside the third medium's answer.

The verdicts go to results/verification.json, which the results page shows; pictures of the deformed
solids with their contact pressure to figures/contact-NAME.png, and the two curves to
figures/verification-NAME.png. Designs that have not changed since are skipped. One to a few minutes
for each on one core.

    python examples/paper/verification_of_gallery.py [NAME ...] [--threads N]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gallery_results import PICTURES, evaluate

from ngspring import Design, NgspringError
from ngspring.solid.verification import verify
from ngspring.view.figure import save_figure
from ngspring.view.solid import contact_states_figure, verification_figure


def evaluation(name: str, design: Design, threads: int | None) -> dict[str, Any]:
    try:
        outcome = verify(design, threads=threads)
    except NgspringError as error:
        print(error)
        return {"error": str(error)}
    save_figure(verification_figure(outcome), PICTURES / f"verification-{name}.png")
    save_figure(contact_states_figure(outcome), PICTURES / f"contact-{name}.png")
    print(outcome.largest_deviation)
    return outcome.to_dict()


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    return evaluate("verification", __doc__, evaluation, arguments)


if __name__ == "__main__":
    main()
