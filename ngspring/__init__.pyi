from .analysis.forward import load_displacement as load_displacement
from .analysis.response import Response as Response
from .analysis.stability import Stability as Stability
from .analysis.stability import stability as stability
from .basics.errors import ConvergenceError as ConvergenceError
from .basics.errors import DesignFileError as DesignFileError
from .basics.errors import ExportError as ExportError
from .basics.errors import NgspringError as NgspringError
from .basics.errors import OutlineError as OutlineError
from .basics.errors import ProblemError as ProblemError
from .basics.errors import RunFolderError as RunFolderError
from .basics.version import __version__ as __version__
from .design.design import Design as Design
from .design.gallery import gallery as gallery
from .design.gallery import parts as parts
from .design.history import History as History
from .design.snapshots import Snapshots as Snapshots
from .evolution.evolve import Evolution as Evolution
from .evolution.evolve import evolve as evolve
from .evolution.family import Family as Family
from .evolution.family import family as family
from .evolution.follow import follow as follow
from .evolution.ladder import NO_LADDER as NO_LADDER
from .evolution.ladder import Ladder as Ladder
from .evolution.optimize import optimize as optimize
from .evolution.runstate import RunState as RunState
from .evolution.runstate import read_run as read_run
from .evolution.steprule import LeapRule as LeapRule
from .evolution.steprule import StepRule as StepRule
from .evolution.updates import Result as Result
from .evolution.updates import Update as Update
from .fem.taylor import taylor_test as taylor_test
from .kkt.compound import CompoundState as CompoundState
from .kkt.compound import compound_state as compound_state
from .kkt.stationarity import Optimality as Optimality
from .kkt.stationarity import optimality as optimality
from .part.realisation import PartSettings as PartSettings
from .part.realise import realise as realise
from .problem.cases import cases as cases
from .problem.cases import get_case as get_case
from .problem.curves.curve import TargetCurve as TargetCurve
from .problem.curves.curve import read_curve as read_curve
from .problem.fit.data import MaterialTest as MaterialTest
from .problem.fit.data import read_material_test as read_material_test
from .problem.fit.fitting import Fit as Fit
from .problem.fit.fitting import fit as fit
from .problem.fit.fitting import fit_all as fit_all
from .problem.material import bulk_and_shear_modulus as bulk_and_shear_modulus
from .problem.material import young_from_shore_A as young_from_shore_A
from .problem.offsets import with_offsets as with_offsets
from .problem.point import ControlPoint as ControlPoint
from .problem.scaling import scaled as scaled
from .problem.scaling import with_similar_weights as with_similar_weights
from .problem.spring import SpringProblem as SpringProblem
from .problem.targets.from_curve import problem_from_curve as problem_from_curve
from .problem.targets.plausibility import Finding as Finding
from .problem.targets.plausibility import check_targets as check_targets
from .solid.contact.response import ContactResponse as ContactResponse
from .solid.contact.response import ContactSettings as ContactSettings
from .solid.contact.response import contact_load_displacement as contact_load_displacement
from .solid.export.export import export_body as export_body
from .solid.imperfection import Imperfection as Imperfection
from .solid.imperfection import imperfection as imperfection
from .solid.mesh.body import Body as Body
from .solid.mesh.mesh_body import mesh_body as mesh_body
from .solid.tolerance import Tolerance as Tolerance
from .solid.tolerance import tolerance as tolerance
from .solid.verification import Verification as Verification
from .solid.verification import verify as verify
from .view.animation import animate_deformation as animate_deformation
from .view.animation import animate_evolution as animate_evolution
from .view.report import ReportWriter as ReportWriter
from .view.report import write_report as write_report

__all__ = [
    "NO_LADDER",
    "Body",
    "CompoundState",
    "ContactResponse",
    "ContactSettings",
    "ControlPoint",
    "ConvergenceError",
    "Design",
    "DesignFileError",
    "Evolution",
    "ExportError",
    "Family",
    "Finding",
    "Fit",
    "History",
    "Imperfection",
    "Ladder",
    "LeapRule",
    "MaterialTest",
    "NgspringError",
    "Optimality",
    "OutlineError",
    "PartSettings",
    "ProblemError",
    "ReportWriter",
    "Response",
    "Result",
    "RunFolderError",
    "RunState",
    "Snapshots",
    "SpringProblem",
    "Stability",
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
    "compound_state",
    "contact_load_displacement",
    "evolve",
    "export_body",
    "family",
    "fit",
    "fit_all",
    "follow",
    "gallery",
    "get_case",
    "imperfection",
    "load_displacement",
    "mesh_body",
    "optimality",
    "optimize",
    "parts",
    "problem_from_curve",
    "read_curve",
    "read_material_test",
    "read_run",
    "realise",
    "scaled",
    "stability",
    "taylor_test",
    "tolerance",
    "verify",
    "with_offsets",
    "with_similar_weights",
    "write_report",
    "young_from_shore_A",
]
