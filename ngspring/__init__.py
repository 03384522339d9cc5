"""Inverse design of springs with a prescribed nonlinear load-displacement curve.

After Bluhm, Sigmund and Poulios (2023), Int. J. Non-Linear Mech. 157, 104552,
https://doi.org/10.1016/j.ijnonlinmec.2023.104552. Lengths are in mm, forces in N, stress in MPa.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ngspring.cases import cases, get_case
from ngspring.errors import (
    ConvergenceError,
    DesignFileError,
    NgspringError,
    ProblemError,
    RunFolderError,
)
from ngspring.problem import ControlPoint, SpringProblem

if TYPE_CHECKING:
    from ngspring.design import Design
    from ngspring.evolution import Result, Update, optimize
    from ngspring.history import History
    from ngspring.response import Response, load_displacement
    from ngspring.stationarity import Optimality, optimality
    from ngspring.steprule import StepRule
    from ngspring.stored import gallery
    from ngspring.taylor import taylor_test

__version__ = "0.1.0"

# What needs NGSolve is imported at its first use, so that `import ngspring` is quick.
_LAZY = {
    "Design": "design",
    "History": "history",
    "Result": "evolution",
    "StepRule": "steprule",
    "Update": "evolution",
    "optimize": "evolution",
    "gallery": "stored",
    "Optimality": "stationarity",
    "optimality": "stationarity",
    "Response": "response",
    "load_displacement": "response",
    "taylor_test": "taylor",
}

__all__ = [
    "ControlPoint",
    "ConvergenceError",
    "Design",
    "DesignFileError",
    "History",
    "NgspringError",
    "Optimality",
    "ProblemError",
    "Response",
    "Result",
    "RunFolderError",
    "SpringProblem",
    "StepRule",
    "Update",
    "cases",
    "gallery",
    "get_case",
    "load_displacement",
    "optimality",
    "optimize",
    "taylor_test",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        value = getattr(importlib.import_module(f"ngspring.{_LAZY[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'ngspring' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
