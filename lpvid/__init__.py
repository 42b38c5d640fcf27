"""lpvid: identification, analysis and control of linear parameter-varying systems.

>>> import lpvid as lpv
>>> lpv.Polynomial("current", degree=1).labels
('1', 'current')

Names load on first use, so that ``import lpvid`` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from lpvid.analysis.bands import free_run_band, frequency_band
    from lpvid.analysis.certificates import certify_stability, verify
    from lpvid.analysis.critical import critical_scheduling
    from lpvid.analysis.decay import decay_rate
    from lpvid.analysis.frozen_stability import frozen_stability
    from lpvid.analysis.gain import Gain, l2_gain, l2_gains
    from lpvid.analysis.h2 import h2_norm
    from lpvid.analysis.hull_certificate import HullCertificate, hull_gain
    from lpvid.analysis.certified_margins import certified_share, largest_range, largest_rate
    from lpvid.analysis.passivity import certify_passivity
    from lpvid.analysis.passivity_certificate import PassivityCertificate
    from lpvid.analysis.passivity_margin import PassivityMargin, passivity_margin
    from lpvid.analysis.pole_locus import pole_locus
    from lpvid.analysis.pole_regions import certify_region
    from lpvid.analysis.robust_certificate import RobustCertificate
    from lpvid.analysis.robust_gain import RobustGain, robust_gain
    from lpvid.analysis.stability_certificate import StabilityCertificate, Verification
    from lpvid.analysis.switching import certify_switching, joint_spectral_radius
    from lpvid.analysis.uncertain_blocks import Delay, Dynamic, Lipschitz, Parametric, Sector
    from lpvid.analysis.uncertainty import pole_band, stability_probability
    from lpvid.auditing import Audit, audit
    from lpvid.diagnosis.asking import diagnose
    from lpvid.diagnosis.baseline import Baseline
    from lpvid.diagnosis.diagnosis import Diagnosis
    from lpvid.diagnosis.effect import Effect
    from lpvid.diagnosis.engine import DiagnosisSettings
    from lpvid.diagnosis.extended import ExtendedModel
    from lpvid.errors import ExtrapolationWarning, InputError, LpvError, NumericalError
    from lpvid.export.control_file import control_system, export_control, to_control
    from lpvid.export.csv_tables import export_csv
    from lpvid.export.exportable import exportable
    from lpvid.export.exporting import export_c
    from lpvid.export.fmu import export_fmu
    from lpvid.export.matlab import export_matlab
    from lpvid.export.modelica import export_modelica
    from lpvid.export.python_control import from_control, to_grid
    from lpvid.export.serialise import load, model_hash, save
    from lpvid.files import read
    from lpvid.identification import Identification, identify
    from lpvid.identification.armax import ARMAX
    from lpvid.identification.arx import ARX
    from lpvid.identification.box_jenkins import BoxJenkins
    from lpvid.identification.canonical_form import CanonicalForm
    from lpvid.identification.compliance import Compliance
    from lpvid.identification.coprime import RightCoprime
    from lpvid.identification.form_refit import FormRefit, refit_form
    from lpvid.identification.output_error import OutputError
    from lpvid.identification.passive import Passive
    from lpvid.identification.quasi_lpv import QuasiLPV
    from lpvid.identification.recursive import Recursive
    from lpvid.identification.refined_iv import RefinedIV
    from lpvid.identification.ridge import Ridge
    from lpvid.identification.selection import Candidates, Selection, auto, select
    from lpvid.identification.sparsity import sparsify
    from lpvid.identification.state_space_error import StateSpaceError
    from lpvid.identification.streaming import identify_stream
    from lpvid.identification.structure import Structure, register_structure
    from lpvid.identification.subspace import Subspace
    from lpvid.lmi.bound_certificate import BoundCertificate
    from lpvid.lmi.gain_certificate import GainCertificate, certify_gain
    from lpvid.model.continuous_run import step_response
    from lpvid.model.hull import Hull
    from lpvid.model.input_stage import TanhStage, ThreeZoneStage
    from lpvid.model.lft import LFTModel
    from lpvid.model.signals import Signal
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.realization import Gap, Realization, realize
    from lpvid.record import Channel, Record
    from lpvid.scheduling import Fourier, Polynomial, Product, Scheduling, Shifted, Spline, Stacked
    from lpvid.simulation import Simulation, predict, simulate
    from lpvid.synthesis.anti_windup import anti_windup, back_calculation
    from lpvid.synthesis.controller_structures import PID, LowOrder, ObserverBased, StaticGain
    from lpvid.synthesis.coprime_reduction import CoprimeReduction, reduce_coprime
    from lpvid.synthesis.criteria import H2, Cone, Disc, HalfPlane, HInfinity
    from lpvid.synthesis.delays import delay, delay_error
    from lpvid.synthesis.discretising import discretise, to_continuous
    from lpvid.synthesis.dissipative_feedback import DissipativeFeedback
    from lpvid.synthesis.filters import steadied
    from lpvid.synthesis.fixed_structure import FixedStructure
    from lpvid.synthesis.forms import from_lft, to_affine, to_gridded, to_lft, to_polynomial, to_polytopic
    from lpvid.synthesis.gain_surface import GainSurface, gain_surface
    from lpvid.synthesis.generalized_plant import GeneralizedPlant
    from lpvid.synthesis.interconnection import close_loop, connect
    from lpvid.synthesis.joining import append, parallel, series, summing_junction
    from lpvid.synthesis.lft_synthesis import LFTFeedback
    from lpvid.synthesis.lifting import lift
    from lpvid.synthesis.lipschitz_observer import LipschitzEstimate, LipschitzObserver
    from lpvid.synthesis.loop_shaping import ShapedDesign, loop_shaping
    from lpvid.synthesis.multiobjective import MultiObjective
    from lpvid.synthesis.observer import Filter, Observer
    from lpvid.synthesis.output_feedback import OutputFeedback
    from lpvid.synthesis.reduction import balanced_realization, reduce_order
    from lpvid.synthesis.result import Synthesis
    from lpvid.synthesis.sampled_plants import from_function, from_grid
    from lpvid.synthesis.sampling_rules import Euler, Taylor, Tustin, ZeroOrderHold
    from lpvid.synthesis.saturated import saturate
    from lpvid.synthesis.scaled_gain import ScaledGain, scaled_gain
    from lpvid.synthesis.state_feedback import StateFeedback
    from lpvid.synthesis.synthesizing import synthesize
    from lpvid.synthesis.attach_weights import weigh
    from lpvid.validation import Validation, validate
    from lpvid.validation.comparing import ModelComparison, compare_models

_EXPORTS = {
    "lpvid.analysis.bands": ("free_run_band", "frequency_band"),
    "lpvid.analysis.certificates": ("certify_stability", "verify"),
    "lpvid.analysis.critical": ("critical_scheduling",),
    "lpvid.analysis.decay": ("decay_rate",),
    "lpvid.analysis.frozen_stability": ("frozen_stability",),
    "lpvid.analysis.gain": ("Gain", "l2_gain", "l2_gains"),
    "lpvid.analysis.h2": ("h2_norm",),
    "lpvid.analysis.hull_certificate": ("HullCertificate", "hull_gain"),
    "lpvid.analysis.certified_margins": ("certified_share", "largest_range", "largest_rate"),
    "lpvid.analysis.passivity": ("certify_passivity",),
    "lpvid.analysis.passivity_certificate": ("PassivityCertificate",),
    "lpvid.analysis.passivity_margin": ("PassivityMargin", "passivity_margin"),
    "lpvid.analysis.pole_locus": ("pole_locus",),
    "lpvid.analysis.pole_regions": ("certify_region",),
    "lpvid.analysis.robust_certificate": ("RobustCertificate",),
    "lpvid.analysis.robust_gain": ("RobustGain", "robust_gain"),
    "lpvid.analysis.stability_certificate": ("StabilityCertificate", "Verification"),
    "lpvid.analysis.switching": ("certify_switching", "joint_spectral_radius"),
    "lpvid.analysis.uncertain_blocks": ("Delay", "Dynamic", "Lipschitz", "Parametric", "Sector"),
    "lpvid.analysis.uncertainty": ("pole_band", "stability_probability"),
    "lpvid.auditing": ("Audit", "audit"),
    "lpvid.diagnosis.asking": ("diagnose",),
    "lpvid.diagnosis.baseline": ("Baseline",),
    "lpvid.diagnosis.diagnosis": ("Diagnosis",),
    "lpvid.diagnosis.effect": ("Effect",),
    "lpvid.diagnosis.engine": ("DiagnosisSettings",),
    "lpvid.diagnosis.extended": ("ExtendedModel",),
    "lpvid.errors": ("ExtrapolationWarning", "InputError", "LpvError", "NumericalError"),
    "lpvid.export.control_file": ("control_system", "export_control", "to_control"),
    "lpvid.export.csv_tables": ("export_csv",),
    "lpvid.export.exportable": ("exportable",),
    "lpvid.export.exporting": ("export_c",),
    "lpvid.export.fmu": ("export_fmu",),
    "lpvid.export.matlab": ("export_matlab",),
    "lpvid.export.modelica": ("export_modelica",),
    "lpvid.export.python_control": ("from_control", "to_grid"),
    "lpvid.export.serialise": ("load", "model_hash", "save"),
    "lpvid.files": ("read",),
    "lpvid.identification": ("Identification", "identify"),
    "lpvid.identification.armax": ("ARMAX",),
    "lpvid.identification.arx": ("ARX",),
    "lpvid.identification.box_jenkins": ("BoxJenkins",),
    "lpvid.identification.canonical_form": ("CanonicalForm",),
    "lpvid.identification.form_refit": ("FormRefit", "refit_form"),
    "lpvid.identification.compliance": ("Compliance",),
    "lpvid.identification.coprime": ("RightCoprime",),
    "lpvid.identification.output_error": ("OutputError",),
    "lpvid.identification.passive": ("Passive",),
    "lpvid.identification.quasi_lpv": ("QuasiLPV",),
    "lpvid.identification.recursive": ("Recursive",),
    "lpvid.identification.refined_iv": ("RefinedIV",),
    "lpvid.identification.ridge": ("Ridge",),
    "lpvid.identification.selection": ("Candidates", "Selection", "auto", "select"),
    "lpvid.identification.sparsity": ("sparsify",),
    "lpvid.identification.state_space_error": ("StateSpaceError",),
    "lpvid.identification.streaming": ("identify_stream",),
    "lpvid.identification.structure": ("Structure", "register_structure"),
    "lpvid.identification.subspace": ("Subspace",),
    "lpvid.lmi.bound_certificate": ("BoundCertificate",),
    "lpvid.lmi.gain_certificate": ("GainCertificate", "certify_gain"),
    "lpvid.model.continuous_run": ("step_response",),
    "lpvid.model.hull": ("Hull",),
    "lpvid.model.input_stage": ("TanhStage", "ThreeZoneStage"),
    "lpvid.model.lft": ("LFTModel",),
    "lpvid.model.signals": ("Signal",),
    "lpvid.model.state_space": ("LPVStateSpace",),
    "lpvid.model.transfer_function": ("LPVTransferFunction",),
    "lpvid.realization": ("Gap", "Realization", "realize"),
    "lpvid.record": ("Channel", "Record"),
    "lpvid.scheduling": ("Fourier", "Polynomial", "Product", "Scheduling", "Shifted", "Spline", "Stacked"),
    "lpvid.simulation": ("Simulation", "predict", "simulate"),
    "lpvid.synthesis.anti_windup": ("anti_windup", "back_calculation"),
    "lpvid.synthesis.controller_structures": ("LowOrder", "ObserverBased", "PID", "StaticGain"),
    "lpvid.synthesis.coprime_reduction": ("CoprimeReduction", "reduce_coprime"),
    "lpvid.synthesis.criteria": ("Cone", "Disc", "H2", "HInfinity", "HalfPlane"),
    "lpvid.synthesis.delays": ("delay", "delay_error"),
    "lpvid.synthesis.discretising": ("discretise", "to_continuous"),
    "lpvid.synthesis.dissipative_feedback": ("DissipativeFeedback",),
    "lpvid.synthesis.filters": ("steadied",),
    "lpvid.synthesis.fixed_structure": ("FixedStructure",),
    "lpvid.synthesis.forms": ("from_lft", "to_affine", "to_gridded", "to_lft", "to_polynomial", "to_polytopic"),
    "lpvid.synthesis.gain_surface": ("GainSurface", "gain_surface"),
    "lpvid.synthesis.generalized_plant": ("GeneralizedPlant",),
    "lpvid.synthesis.interconnection": ("close_loop", "connect"),
    "lpvid.synthesis.joining": ("append", "parallel", "series", "summing_junction"),
    "lpvid.synthesis.lft_synthesis": ("LFTFeedback",),
    "lpvid.synthesis.lifting": ("lift",),
    "lpvid.synthesis.lipschitz_observer": ("LipschitzEstimate", "LipschitzObserver"),
    "lpvid.synthesis.loop_shaping": ("ShapedDesign", "loop_shaping"),
    "lpvid.synthesis.multiobjective": ("MultiObjective",),
    "lpvid.synthesis.observer": ("Filter", "Observer"),
    "lpvid.synthesis.output_feedback": ("OutputFeedback",),
    "lpvid.synthesis.reduction": ("balanced_realization", "reduce_order"),
    "lpvid.synthesis.result": ("Synthesis",),
    "lpvid.synthesis.sampling_rules": ("Euler", "Taylor", "Tustin", "ZeroOrderHold"),
    "lpvid.synthesis.sampled_plants": ("from_function", "from_grid"),
    "lpvid.synthesis.saturated": ("saturate",),
    "lpvid.synthesis.scaled_gain": ("ScaledGain", "scaled_gain"),
    "lpvid.synthesis.state_feedback": ("StateFeedback",),
    "lpvid.synthesis.synthesizing": ("synthesize",),
    "lpvid.synthesis.attach_weights": ("weigh",),
    "lpvid.validation": ("Validation", "validate"),
    "lpvid.validation.comparing": ("ModelComparison", "compare_models"),
}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = [
    "ARMAX",
    "ARX",
    "H2",
    "PID",
    "Audit",
    "Baseline",
    "BoundCertificate",
    "BoxJenkins",
    "Candidates",
    "CanonicalForm",
    "Channel",
    "Compliance",
    "Cone",
    "CoprimeReduction",
    "Delay",
    "Diagnosis",
    "DiagnosisSettings",
    "Disc",
    "DissipativeFeedback",
    "Dynamic",
    "Effect",
    "Euler",
    "ExtendedModel",
    "ExtrapolationWarning",
    "Filter",
    "FixedStructure",
    "FormRefit",
    "Fourier",
    "Gain",
    "GainCertificate",
    "GainSurface",
    "Gap",
    "GeneralizedPlant",
    "HInfinity",
    "HalfPlane",
    "Hull",
    "HullCertificate",
    "Identification",
    "InputError",
    "LFTFeedback",
    "LFTModel",
    "LPVStateSpace",
    "LPVTransferFunction",
    "Lipschitz",
    "LipschitzEstimate",
    "LipschitzObserver",
    "LowOrder",
    "LpvError",
    "ModelComparison",
    "MultiObjective",
    "NumericalError",
    "Observer",
    "ObserverBased",
    "OutputError",
    "OutputFeedback",
    "Parametric",
    "Passive",
    "PassivityCertificate",
    "PassivityMargin",
    "Polynomial",
    "Product",
    "QuasiLPV",
    "Realization",
    "Record",
    "Recursive",
    "RefinedIV",
    "Ridge",
    "RightCoprime",
    "RobustCertificate",
    "RobustGain",
    "ScaledGain",
    "Scheduling",
    "Sector",
    "Selection",
    "ShapedDesign",
    "Shifted",
    "Signal",
    "Simulation",
    "Spline",
    "StabilityCertificate",
    "Stacked",
    "StateFeedback",
    "StateSpaceError",
    "StaticGain",
    "Structure",
    "Subspace",
    "Synthesis",
    "TanhStage",
    "Taylor",
    "ThreeZoneStage",
    "Tustin",
    "Validation",
    "Verification",
    "ZeroOrderHold",
    "anti_windup",
    "append",
    "audit",
    "auto",
    "back_calculation",
    "balanced_realization",
    "certified_share",
    "certify_gain",
    "certify_passivity",
    "certify_region",
    "certify_stability",
    "certify_switching",
    "close_loop",
    "compare_models",
    "connect",
    "control_system",
    "critical_scheduling",
    "decay_rate",
    "delay",
    "delay_error",
    "diagnose",
    "discretise",
    "export_c",
    "export_control",
    "export_csv",
    "export_fmu",
    "export_matlab",
    "export_modelica",
    "exportable",
    "free_run_band",
    "frequency_band",
    "from_control",
    "from_function",
    "from_grid",
    "from_lft",
    "frozen_stability",
    "gain_surface",
    "h2_norm",
    "hull_gain",
    "identify",
    "identify_stream",
    "joint_spectral_radius",
    "l2_gain",
    "l2_gains",
    "largest_range",
    "largest_rate",
    "lift",
    "load",
    "loop_shaping",
    "model_hash",
    "parallel",
    "passivity_margin",
    "pole_band",
    "pole_locus",
    "predict",
    "read",
    "realize",
    "reduce_coprime",
    "reduce_order",
    "refit_form",
    "register_structure",
    "robust_gain",
    "saturate",
    "save",
    "scaled_gain",
    "select",
    "series",
    "simulate",
    "sparsify",
    "stability_probability",
    "steadied",
    "step_response",
    "summing_junction",
    "synthesize",
    "to_affine",
    "to_continuous",
    "to_control",
    "to_grid",
    "to_gridded",
    "to_lft",
    "to_polynomial",
    "to_polytopic",
    "validate",
    "verify",
    "weigh",
]


def __getattr__(name: str):
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'lpvid' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
