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

For a setup, or a log, verbs also take the path of its file. They compute in float64 whatever JAX's setting is, give
numpy arrays back, and leave JAX's settings as they are but for one: compiled programs are kept in ``~/.cache/ftbias``
from the first verb on, unless JAX has a cache already or the environment says ``FTBIAS_CACHE=off``. What is part of
your own programs (``params_for_log``, ``samples_from_log``, ``filter_samples``, ``log_likelihood``, ``unconstrain``,
``constrain``) is plain JAX in JAX's own precision.

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
    """A public name, imported on its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return [*__all__, "__version__"]
