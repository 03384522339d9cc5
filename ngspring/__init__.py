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
    ExportError,
    NgspringError,
    OutlineError,
    ProblemError,
    RunFolderError,
)
from ngspring.problem import ControlPoint, SpringProblem

if TYPE_CHECKING:
    from ngspring.animation import animate_deformation, animate_evolution
    from ngspring.body import Body
    from ngspring.bodymesh import mesh_body
    from ngspring.contact_response import (
        ContactResponse,
        ContactSettings,
        contact_load_displacement,
    )
    from ngspring.design import Design
    from ngspring.evolution import optimize
    from ngspring.export import export_body
    from ngspring.history import History
    from ngspring.html_report import ReportWriter, write_report
    from ngspring.material import bulk_and_shear_modulus, young_from_shore_A
    from ngspring.offsets import Tolerance, tolerance
    from ngspring.plausibility import Finding, check_targets
    from ngspring.response import Response, load_displacement
    from ngspring.runstate import RunState, read_run
    from ngspring.scaling import scaled, with_similar_weights
    from ngspring.snapshots import Snapshots
    from ngspring.stationarity import Optimality, optimality
    from ngspring.steprule import LeapRule, StepRule
    from ngspring.stored import gallery
    from ngspring.targets import TargetCurve, read_curve
    from ngspring.taylor import taylor_test
    from ngspring.updates import Result, Update
    from ngspring.verification import Verification, verify

__version__ = "0.1.0"

# What needs NGSolve is imported at its first use, so that `import ngspring` is quick.
_LAZY = {
    "animate_deformation": "animation",
    "animate_evolution": "animation",
    "Body": "body",
    "mesh_body": "bodymesh",
    "ContactResponse": "contact_response",
    "ContactSettings": "contact_response",
    "contact_load_displacement": "contact_response",
    "export_body": "export",
    "Tolerance": "offsets",
    "tolerance": "offsets",
    "Verification": "verification",
    "verify": "verification",
    "Design": "design",
    "History": "history",
    "ReportWriter": "html_report",
    "write_report": "html_report",
    "RunState": "runstate",
    "read_run": "runstate",
    "Snapshots": "snapshots",
    "Result": "updates",
    "LeapRule": "steprule",
    "StepRule": "steprule",
    "Update": "updates",
    "optimize": "evolution",
    "gallery": "stored",
    "Optimality": "stationarity",
    "optimality": "stationarity",
    "Response": "response",
    "load_displacement": "response",
    "Finding": "plausibility",
    "check_targets": "plausibility",
    "TargetCurve": "targets",
    "read_curve": "targets",
    "bulk_and_shear_modulus": "material",
    "young_from_shore_A": "material",
    "scaled": "scaling",
    "with_similar_weights": "scaling",
    "taylor_test": "taylor",
}

__all__ = [
    "Body",
    "ContactResponse",
    "ContactSettings",
    "ControlPoint",
    "ConvergenceError",
    "Design",
    "DesignFileError",
    "ExportError",
    "Finding",
    "History",
    "LeapRule",
    "NgspringError",
    "Optimality",
    "OutlineError",
    "ProblemError",
    "ReportWriter",
    "Response",
    "Result",
    "RunFolderError",
    "RunState",
    "Snapshots",
    "SpringProblem",
    "StepRule",
    "TargetCurve",
    "Tolerance",
    "Update",
    "Verification",
    "animate_deformation",
    "animate_evolution",
    "bulk_and_shear_modulus",
    "cases",
    "check_targets",
    "contact_load_displacement",
    "export_body",
    "gallery",
    "get_case",
    "load_displacement",
    "mesh_body",
    "optimality",
    "optimize",
    "read_curve",
    "read_run",
    "scaled",
    "taylor_test",
    "tolerance",
    "verify",
    "with_similar_weights",
    "write_report",
    "young_from_shore_A",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        value = getattr(importlib.import_module(f"ngspring.{_LAZY[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'ngspring' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
