"""The gallery: finished designs that come with the package, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.resources import as_file, files
from typing import TYPE_CHECKING

from ngspring.basics.checks import nearest, shown
from ngspring.basics.errors import DesignFileError
from ngspring.design.design import Design
from ngspring.problem.cases import cases

if TYPE_CHECKING:
    from importlib.abc import Traversable

#: The file with the load path of the design C7 is states-C7.npz.
STATES = "states-"


class UnknownDesignError(DesignFileError, KeyError):
    """There is no stored design of this name."""

    __str__ = ValueError.__str__


class Gallery(Mapping[str, Design]):
    """Read-only mapping from names to stored designs, each loaded when asked for.

    Attributes
    ----------
    folder : path
        Where they are.
    """

    def __init__(self, folder: str = "stored") -> None:
        self.folder = files("ngspring.design") / folder

    def _names(self) -> list[str]:
        if not self.folder.is_dir():
            return []
        names = [entry.name for entry in self.folder.iterdir()]
        # Snapshots of a run (Fig. 16) and load paths lie beside the designs.
        return sorted(
            name.removesuffix(".npz")
            for name in names
            if name.endswith(".npz") and not name.startswith(("snapshots-", STATES))
        )

    def __getitem__(self, name: str) -> Design:
        """The design of this name.

        Raises
        ------
        UnknownDesignError
            If there is none; the message names the nearest one.
        """
        names = self._names()
        if name not in names:
            hint = f": did you mean {nearest(str(name), names)!r}?" if names else ""
            if str(name).upper() in cases:
                hint = f" for this case yet; there are {', '.join(names)}"
            raise UnknownDesignError(f"there is no stored design {shown(name)}{hint}")
        with as_file(self.folder / f"{name}.npz") as path:
            return Design.load(path)

    def states(self, case: str) -> list[Traversable]:
        """Files that may hold the load path of a stored design of a case.

        See `ngspring.analysis.stored`.
        """
        names = [name for name in self._names() if name == case or name.startswith(f"{case}-")]
        files = [self.folder / f"{STATES}{name}.npz" for name in names]
        return [file for file in files if file.is_file()]

    def __repr__(self) -> str:
        return f"<gallery of stored designs: {', '.join(self)}>"

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())


gallery = Gallery()
"""The stored designs."""

parts = Gallery("parts")
"""Those whose solids go through the targets (`ngspring.realise`), under the same names.

One such as C4-stable is another part of that case, which an imperfection keeps from buckling.
"""

#: A stored part of the case C4 is called C4-part where a name stands for itself.
PART = "-part"


def stored_design(name: str) -> Design:
    """The design of the gallery that has this name, or the part, for one such as ``C4-part``.

    Raises
    ------
    UnknownDesignError
        If there is none.
    """
    case = name.removesuffix(PART)
    return parts[case] if case != name and case in parts else gallery[name]
