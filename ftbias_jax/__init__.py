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

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ftbias_jax.calibration.identify import Identified as Identified
    from ftbias_jax.calibration.identify_tool import IdentifyResult as IdentifyResult
    from ftbias_jax.calibration.identify_tool import identify_tool as identify_tool
    from ftbias_jax.calibration.noise.values import constrain as constrain
    from ftbias_jax.calibration.noise.values import unconstrain as unconstrain
    from ftbias_jax.calibration.tune_result import TuneResult as TuneResult
    from ftbias_jax.calibration.tune_setup import tune as tune
    from ftbias_jax.check.check_setup import check_setup as check_setup
    from ftbias_jax.check.result import Check as Check
    from ftbias_jax.check.result import Mistake as Mistake
    from ftbias_jax.commissioning.calibrate import calibrate as calibrate
    from ftbias_jax.commissioning.each import diagnose_each as diagnose_each
    from ftbias_jax.commissioning.each import identify_each as identify_each
    from ftbias_jax.commissioning.payloads import Payloads as Payloads
    from ftbias_jax.commissioning.payloads import identify_payloads as identify_payloads
    from ftbias_jax.commissioning.result import Calibrated as Calibrated
    from ftbias_jax.diagnosis.diagnose import diagnose as diagnose
    from ftbias_jax.diagnosis.pooled import diagnose_pooled as diagnose_pooled
    from ftbias_jax.diagnosis.result import Candidate as Candidate
    from ftbias_jax.diagnosis.result import Diagnosis as Diagnosis
    from ftbias_jax.errors import FtbiasError as FtbiasError
    from ftbias_jax.errors import LogError as LogError
    from ftbias_jax.errors import OutputError as OutputError
    from ftbias_jax.errors import SetupError as SetupError
    from ftbias_jax.errors import UsageError as UsageError
    from ftbias_jax.filtering.likelihood import log_likelihood as log_likelihood
    from ftbias_jax.filtering.method.filter_samples import filter_samples as filter_samples
    from ftbias_jax.filtering.noise.blocks import layout_of as layout_of
    from ftbias_jax.filtering.params_for_log import params_for_log as params_for_log
    from ftbias_jax.filtering.pipeline import Options as Options
    from ftbias_jax.filtering.pipeline import options_from_setup as options_from_setup
    from ftbias_jax.filtering.samples import samples_from_log as samples_from_log
    from ftbias_jax.filtering.verbs.from_setup import filter_log as filter_log
    from ftbias_jax.filtering.verbs.results import FilterResult as FilterResult
    from ftbias_jax.filtering.verbs.results import FilterResults as FilterResults
    from ftbias_jax.filtering.verbs.setup_with import setup_with as setup_with
    from ftbias_jax.io import read_log as read_log
    from ftbias_jax.io.log import Log as Log
    from ftbias_jax.io.log import Repair as Repair
    from ftbias_jax.io.tables.poses import Poses as Poses
    from ftbias_jax.io.tables.poses import read_poses as read_poses
    from ftbias_jax.model.effects.catalogue import CATALOGUE as CATALOGUE
    from ftbias_jax.model.effects.types import Effect as Effect
    from ftbias_jax.model.effects.types import Parameter as Parameter
    from ftbias_jax.model.effects.types import Signals as Signals
    from ftbias_jax.model.effects.types import Twin as Twin
    from ftbias_jax.model.own_effects import load_effects as load_effects
    from ftbias_jax.model.params import Params as Params
    from ftbias_jax.model.simulate_log import SimulationResult as SimulationResult
    from ftbias_jax.model.simulate_log import Truth as Truth
    from ftbias_jax.model.simulate_log import simulate as simulate
    from ftbias_jax.planning.plan import plan as plan
    from ftbias_jax.planning.result import Plan as Plan
    from ftbias_jax.runtime.many import Results as Results
    from ftbias_jax.setup import Setup as Setup
    from ftbias_jax.setup import dump_setup as dump_setup
    from ftbias_jax.setup import load_setup as load_setup
    from ftbias_jax.setup import parse_setup as parse_setup
    from ftbias_jax.simulators.sensor_file import load_sensor_model as load_sensor_model
    from ftbias_jax.simulators.sensor_file import sensor_model as sensor_model
    from ftbias_jax.simulators.sensor_model import SensorModel as SensorModel
    from ftbias_jax.types import Sample as Sample

__version__ = "0.1.0"

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
__all__ = sorted(_MODULE_OF)


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
