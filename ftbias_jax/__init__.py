"""Bias and drift of a wrist force-torque sensor from a recorded log, and what the model of robot and tool misses.

::

    import ftbias_jax as ft

    setup = ft.load_setup("setup.toml")
    log = ft.read_log("log.npz", setup)
    check = ft.check_setup(setup, [log])                # print(check): units, signs, frames
    result = ft.filter_log(setup, log, smooth=True)     # result.bias, .bias_std, .wrench_unbiased, ...
    results = ft.filter_log(setup, paths)               # many logs: one result each, results.errors; executor=
    found = ft.diagnose_each(setup, paths)              # the same; identify_each
    tuned = ft.tune(setup, [log])                       # tuned.setup
    found = ft.identify_tool(setup, log)                # found.setup
    made = ft.simulate(setup, {"gain": {}})             # made.log, made.truth
    diagnosis = ft.diagnose(setup, [log])               # print(diagnosis); diagnosis.apply(setup)
    plan = ft.plan(setup, "tool")                       # the next motion: print(plan); plan.save("motion.csv")
    found = ft.calibrate(setup, [log])                  # all of that; found.setup keeps what predicts better
    sensor = ft.sensor_model(setup)                     # its errors, step by step, for any simulator
    setup = ft.setup_with(setup, params)                # params that a program of your own made likelier

The verbs compute in float64 whatever JAX's setting is, give numpy arrays back, and leave JAX's settings as they are but
for one: compiled programs are kept in ``~/.cache/ftbias`` from the first verb on, unless JAX has a cache already or the
environment says ``FTBIAS_CACHE=off``. What is part of your own programs (``params_for_log``, ``samples_from_log``,
``filter_samples``, ``log_likelihood``, ``unconstrain``, ``constrain``) is plain JAX in JAX's own precision.

Names are imported when they are first used, so importing this package imports neither JAX nor numpy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ftbias_jax.calibration.identify import Identified
    from ftbias_jax.calibration.identify_tool import IdentifyResult, identify_tool
    from ftbias_jax.calibration.noise.values import constrain, unconstrain
    from ftbias_jax.calibration.tune_result import TuneResult
    from ftbias_jax.calibration.tune_setup import tune
    from ftbias_jax.check.check_setup import check_setup
    from ftbias_jax.check.result import Check, Mistake
    from ftbias_jax.commissioning.calibrate import calibrate
    from ftbias_jax.commissioning.each import diagnose_each, identify_each
    from ftbias_jax.commissioning.payloads import Payloads, identify_payloads
    from ftbias_jax.commissioning.result import Calibrated
    from ftbias_jax.diagnosis.diagnose import diagnose
    from ftbias_jax.diagnosis.pooled import diagnose_pooled
    from ftbias_jax.diagnosis.result import Candidate, Diagnosis
    from ftbias_jax.errors import FtbiasError, LogError, OutputError, SetupError, UsageError
    from ftbias_jax.filtering.likelihood import log_likelihood
    from ftbias_jax.filtering.method.filter_samples import filter_samples
    from ftbias_jax.filtering.noise.blocks import layout_of
    from ftbias_jax.filtering.params_for_log import params_for_log
    from ftbias_jax.filtering.pipeline import Options, options_from_setup
    from ftbias_jax.filtering.samples import samples_from_log
    from ftbias_jax.filtering.verbs.from_setup import filter_log
    from ftbias_jax.filtering.verbs.results import FilterResult, FilterResults
    from ftbias_jax.filtering.verbs.setup_with import setup_with
    from ftbias_jax.io import read_log
    from ftbias_jax.io.log import Log, Repair
    from ftbias_jax.io.tables.poses import Poses, read_poses
    from ftbias_jax.model.effects.catalogue import CATALOGUE
    from ftbias_jax.model.effects.types import Effect, Parameter, Signals, Twin
    from ftbias_jax.model.own_effects import load_effects
    from ftbias_jax.model.params import Params
    from ftbias_jax.model.simulate_log import SimulationResult, Truth, simulate
    from ftbias_jax.planning.plan import plan
    from ftbias_jax.planning.result import Plan
    from ftbias_jax.runtime.many import Results
    from ftbias_jax.setup import Setup, dump_setup, load_setup, parse_setup
    from ftbias_jax.simulators.sensor_file import load_sensor_model, sensor_model
    from ftbias_jax.simulators.sensor_model import SensorModel
    from ftbias_jax.types import Sample

__version__ = "0.1.0"

__all__ = [
    "CATALOGUE",
    "Calibrated",
    "Candidate",
    "Check",
    "Diagnosis",
    "Effect",
    "FilterResult",
    "FilterResults",
    "FtbiasError",
    "Identified",
    "IdentifyResult",
    "Log",
    "LogError",
    "Mistake",
    "Options",
    "OutputError",
    "Parameter",
    "Params",
    "Payloads",
    "Plan",
    "Poses",
    "Repair",
    "Results",
    "Sample",
    "SensorModel",
    "Setup",
    "SetupError",
    "Signals",
    "SimulationResult",
    "Truth",
    "TuneResult",
    "Twin",
    "UsageError",
    "calibrate",
    "check_setup",
    "constrain",
    "diagnose",
    "diagnose_each",
    "diagnose_pooled",
    "dump_setup",
    "filter_log",
    "filter_samples",
    "identify_each",
    "identify_payloads",
    "identify_tool",
    "layout_of",
    "load_effects",
    "load_sensor_model",
    "load_setup",
    "log_likelihood",
    "options_from_setup",
    "params_for_log",
    "parse_setup",
    "plan",
    "read_log",
    "read_poses",
    "samples_from_log",
    "sensor_model",
    "setup_with",
    "simulate",
    "tune",
    "unconstrain",
]

_MODULES = {
    "calibration.noise.values": "constrain unconstrain",
    "calibration.identify": "Identified",
    "calibration.identify_tool": "IdentifyResult identify_tool",
    "calibration.tune_result": "TuneResult",
    "calibration.tune_setup": "tune",
    "commissioning.calibrate": "calibrate",
    "commissioning.each": "diagnose_each identify_each",
    "commissioning.payloads": "Payloads identify_payloads",
    "commissioning.result": "Calibrated",
    "diagnosis.diagnose": "diagnose",
    "diagnosis.pooled": "diagnose_pooled",
    "diagnosis.result": "Candidate Diagnosis",
    "errors": "FtbiasError LogError OutputError SetupError UsageError",
    "check.check_setup": "check_setup",
    "check.result": "Check Mistake",
    "filtering.likelihood": "log_likelihood",
    "filtering.method.filter_samples": "filter_samples",
    "filtering.noise.blocks": "layout_of",
    "filtering.params_for_log": "params_for_log",
    "filtering.pipeline": "Options options_from_setup",
    "filtering.samples": "samples_from_log",
    "filtering.verbs.from_setup": "filter_log",
    "filtering.verbs.results": "FilterResult FilterResults",
    "filtering.verbs.setup_with": "setup_with",
    "io": "read_log",
    "io.log": "Log Repair",
    "io.tables.poses": "Poses read_poses",
    "model.effects.catalogue": "CATALOGUE",
    "model.effects.types": "Effect Parameter Signals Twin",
    "model.own_effects": "load_effects",
    "model.params": "Params",
    "model.simulate_log": "SimulationResult Truth simulate",
    "planning.plan": "plan",
    "planning.result": "Plan",
    "runtime.many": "Results",
    "setup": "Setup dump_setup load_setup parse_setup",
    "simulators.sensor_file": "load_sensor_model sensor_model",
    "simulators.sensor_model": "SensorModel",
    "types": "Sample",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """A public name, imported on its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return [*__all__, "__version__"]
