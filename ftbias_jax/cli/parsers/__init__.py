"""The arguments of every command; light, so that ``--help`` answers at once."""

from __future__ import annotations

from ftbias_jax.cli.parsers import calibration, diagnosis, filtering, logs, setups

ADD = (
    setups.add_setup,
    filtering.add_filter,
    calibration.add_tune,
    calibration.add_identify,
    calibration.add_calibrate,
    setups.add_export,
    logs.add_check,
    logs.add_simulate,
    diagnosis.add_diagnose,
    diagnosis.add_effects_command,
    logs.add_info,
    logs.add_report,
    logs.add_compare,
    logs.add_demo,
)
"""In the order of ``ftbias --help``."""
