"""The command ``ngspring materials``."""

from __future__ import annotations

import click
from rich.table import Table

from ngspring.cli.tables import make_console, new_table
from ngspring.problem.laws.named import NAMED, SOURCE
from ngspring.problem.material import ELASTOMERS, GENT_RANGE, NEAREST_NU, NU, young_from_shore_A


@click.command("materials")
def materials_command() -> None:
    """List common elastomers with their hardness and Young's modulus.

    The moduli are Gent's relation for the hardness, no measurements. A few silicones have a law
    that was fitted to a test instead.
    """
    console = make_console()
    console.print(_materials_table())
    console.print(_laws_table())


def _materials_table() -> Table:

    def modulus(hardness: float) -> str:
        beyond = "~" if not GENT_RANGE[0] <= hardness <= GENT_RANGE[1] else ""
        return f"{beyond}{young_from_shore_A(hardness):.2g}"

    columns = ("material", "symbol", "Shore A", "E [MPa]", "typical", "E [MPa]", "made")
    texts = ("material", "symbol", "made")
    table = new_table(*columns, texts=texts, title="common elastomers")
    table.caption = (
        "Hardness as commonly offered; E from it by A. N. Gent, Rubber Chem. Technol. 31"
        " (1958) 896, good for 20 to 80 Shore A and to about 20 %; ~ is beyond. A tensile test of"
        f" your own material is better. nu = {NU:g}, the paper's, unless it is given; real rubber"
        f" is closer to 0.5, and may be given up to {NEAREST_NU:g}."
    )
    for e in ELASTOMERS:
        low, high = e.shore_A
        table.add_row(
            e.name,
            e.symbol,
            f"{low:g} - {high:g}",
            f"{modulus(low)} - {modulus(high)}",
            f"{e.typical:g}",
            modulus(e.typical),
            e.note,
        )
    return table


def _laws_table() -> Table:
    columns = ("material", "mu1 [MPa]", "alpha1", "E [MPa]", "stress at 100 % [MPa]")
    table = new_table(*columns, texts=("material",), title="silicones with a law of their own")
    table.caption = (
        "One term of Ogden's law within 2 % of the nominal stresses at strains of 0.5, 1 and 2."
        f' {SOURCE}. Found by name: material = "Ecoflex 00-30", with nu (0.45 by default).'
    )
    for each in NAMED.values():
        row = (f"{each.mu1:.4g}", f"{each.alpha1:.4g}", f"{each.E:.3g}", f"{each.stresses[1]:g}")
        table.add_row(each.name, *row)
    return table
