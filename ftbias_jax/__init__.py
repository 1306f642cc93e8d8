"""Estimate bias and drift of a wrist force-torque sensor from logs, and diagnose what the robot and tool model misses.

::

    import ftbias_jax as ft

    setup = ft.load_setup("setup.toml")
    log = ft.read_log("log.npz", setup)
    check = ft.check_setup(setup, [log])                # print(check): units, signs, frames
    result = ft.filter_log(setup, log, smooth=True)     # result.bias, .bias_std, .wrench_unbiased, ...
    results = ft.filter_log(setup, paths)               # many logs: one result per log, results.errors; executor=
    found = ft.diagnose_each(setup, paths)              # the same for diagnoses; also identify_each
    tuned = ft.tune(setup, [log])                       # tuned.setup
    found = ft.identify_tool(setup, log)                # found.setup
    made = ft.simulate(setup, {"gain": {}})             # made.log, made.truth
    diagnosis = ft.diagnose(setup, [log])               # print(diagnosis); diagnosis.apply(setup)
    plan = ft.plan(setup, "tool")                       # motion to record next: print(plan); plan.save("motion.csv")
    found = ft.calibrate(setup, [log])                  # all these steps; found.setup keeps those that predict better
    sensor = ft.sensor_model(setup)                     # the sensor's errors, step by step, for any simulator
    setup = ft.setup_with(setup, params)                # params whose noise your own program has optimised

The verbs, as these functions are called, also accept the path of a file for a setup or a log. They compute in float64
whatever JAX's setting is, return numpy arrays, and leave JAX's settings unchanged except for one: compiled programs are
cached in ``~/.cache/ftbias`` from the first verb on, unless JAX already has a cache or the environment sets
``FTBIAS_CACHE=off``. Functions for use in your own programs (``params_for_log``, ``samples_from_log``,
``filter_samples``, ``log_likelihood``, ``unconstrain``, ``constrain``) are plain JAX in JAX's own precision.

Names are imported when they are first used, so importing this package imports neither JAX nor numpy.
"""

import importlib
import re
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULE_OF = {name: module for module, name in re.findall(r"^from ftbias_jax\.(\S+) import (\w+) as ", _STUB, re.M)}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Return a public name, imported on its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return [*__all__, "__version__"]
