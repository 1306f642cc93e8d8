"""The labels of a set in truth.json: the effects applied to each log, in the terms of the catalogue."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Array

FAINT = 0.3
"""Gap in noise sigmas below which a single effect is listed but not counted."""
WITHOUT_GAP = ("noise_level", "outliers", "quantisation", "saturation", "vibration")
"""Effects that count however small the mean gap is, because they show in single samples."""


class Withheld(NamedTuple):
    """Label of an effect that is in no catalogue."""

    kind: str
    form: str
    drive: str
    """Quantity on which the extra wrench depends: one of the drives of a diagnosis's terms."""
    equivalent: tuple[str, ...]
    """Drives that are physically equivalent."""
    catalogue_twins: tuple[str, ...]
    """Catalogue effects that are nearly the same."""
    frame: str
    acts_as: str
    coefficients: dict[str, Any]
    """Unit -> number or numbers, if one coefficient describes the effect completely."""
    oracle_shrink: float | None
    """Shrink of an oracle that subtracts the extra wrench exactly; None without a mean gap."""
    unseen: bool


class Label(NamedTuple):
    """True effects and noise of one log."""

    effects: dict[str, dict[str, Any]]
    """Name -> parameters as defined by the generator of the log; empty = no effect was applied."""
    forms: dict[str, str]
    """Functional form of each effect, if the generator states it."""
    gap_sigmas: float
    """Rms over the channels of the effects' change of the reading, in noise sigmas, after removing a linear trend."""
    sigma: tuple[float, ...]
    """(6,) N, Nm, standard deviation of the noise of one sample."""
    withheld: Withheld | None = None
    """Label of the effect in a log of a withheld kind; None in other logs."""

    @property
    def name(self) -> str:
        """Names of the effects joined by "+", or "none"."""
        return "+".join(self.effects) or "none"

    @property
    def group(self) -> str:
        """Group that selects the scoring rule: none, unlisted, pair, faint or single."""
        if not self.effects:
            return "none"
        if any(effect not in CATALOGUE for effect in self.effects):
            return "unlisted"
        if len(self.effects) > 1:
            return "pair"
        faint = self.gap_sigmas < FAINT and not set(self.effects) & set(WITHOUT_GAP)
        return "faint" if faint else "single"


def read_labels(folder: Path, logs: Sequence[str]) -> dict[str, Label]:
    """Read the labels of the named logs.

    Raises:
        LogError: truth.json is missing or malformed, or lacks a log.
    """
    path = folder / "truth.json"
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        remedy = "python experiments/validation make writes it last: make the set again"
        raise LogError(f"cannot be read: {error.strerror}", file=path, remedy=remedy) from error
    except ValueError as error:
        raise LogError(f"is no JSON: {error}", file=path, remedy="make the set again") from error
    try:
        return {name: _label(content[name]) for name in logs}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        message = f"has no proper label of every log: {type(error).__name__} {error}"
        raise LogError(message, file=path, remedy="make the set again") from error


def _label(entry: Mapping[str, Any]) -> Label:
    effects = {name: dict(values) for name, values in entry["effects"].items() if name != "none"}
    sigma = tuple(float(x) for x in entry["sigma"])
    forms = dict(entry.get("form", {}))
    return Label(effects, forms, float(entry["gap_sigmas"]), sigma, _withheld(effects, forms, entry.get("term")))


def _withheld(effects: Mapping[str, Any], forms: Mapping[str, str], entry: Mapping[str, Any] | None) -> Withheld | None:
    if entry is None:
        return None
    (kind,) = effects
    oracle = entry["oracle_shrink"]
    return Withheld(
        kind=kind,
        form=forms[kind],
        drive=str(entry["drive"]),
        equivalent=tuple(entry["equivalent"]),
        catalogue_twins=tuple(entry["catalogue_twins"]),
        frame=str(entry["frame"]),
        acts_as=str(entry["acts_as"]),
        coefficients=dict(entry["coefficients"]),
        oracle_shrink=None if oracle is None else float(oracle),
        unseen=bool(entry["unseen"]),
    )


def true_parameters(label: Label, effect: str) -> dict[str, Any]:
    """Return the true parameters of an effect as the catalogue defines them; NaN = unknown.

    Parameters without a counterpart are omitted: the time constant of two exponentials, the size of spikes of varying
    size, and the force of a contact that rotates with the tool (the catalogue's is fixed in the base frame).
    """
    return _CONVERSIONS[effect](label.effects[effect], label.forms.get(effect, ""), label)


Conversion = Callable[[dict[str, Any], str, Label], dict[str, Any]]


def _renamed(**names: str) -> Conversion:
    """Conversion of parameters that differ only in name, given as catalogue name = label name."""
    return lambda values, form, label: {ours: values[theirs] for ours, theirs in names.items() if theirs in values}


def _mount_rotation(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    return {"rotation": _rotation_vector(rotation_from_rpy(np.asarray(values["rpy"], float)))}


def _rotation_vector(R: Array) -> Array:
    """Rotation vector (3,) rad of R (3, 3), for angles below half a turn."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2  # times the sine of the angle
    sine = np.linalg.norm(axis)
    return axis if sine == 0 else axis / sine * np.arctan2(sine, (np.trace(R) - 1) / 2)


def _saturation(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    limits = np.array(values.get("limits", [np.nan] * 6), float)
    return {"limits": np.where(np.arange(6) < 3, limits, np.nan) if form == "force_only" else limits}


def _quantisation(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    return {"step": values.get("step", values["in_noise_sigmas"] * np.array(label.sigma))}


def _noise_level(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    return {"scale": values.get("per_channel", [values["scale"]] * 6)}


def _outliers(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    size = {} if form == "spread" else {"size": values["sigmas"] * np.array(label.sigma)}
    return {"rate": values["rate"], **size}


def _warmup(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    tau = {} if "tau_2" in values else {"tau": values["tau"]}
    return {"amplitude": values["amplitude"], **tau}


def _cable(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    points = _renamed(anchor="anchor_point", attachment="tool_point")(values, form, label)
    world = {"link": 0.0} if values["anchor"] == "world" else {}
    return {"stiffness": values["stiffness"], "rest_length": values["length"], **points, **world}


def _contact(values: dict[str, Any], form: str, label: Label) -> dict[str, Any]:
    events = values["events"]
    found = {
        "start": np.array([event[0] for event in events], float),
        "end": np.array([event[0] + event[1] for event in events], float),
        "point": np.array([event[3] for event in events], float),
    }
    if values.get("frame", "base") == "base":
        found["force"] = np.array([event[2] for event in events], float)
    return found


_CONVERSIONS: dict[str, Conversion] = {
    "tool_mass": _renamed(mass="mass"),
    "tool_com": _renamed(center_of_mass="com"),
    "tool_inertia": _renamed(inertia="inertia"),
    "gravity_tilt": _renamed(gravity="gravity"),
    "mount_rotation": _mount_rotation,
    "encoder_offset": _renamed(joint="joint", offset="offset"),
    "joint_flexibility": _renamed(),
    "gain": _renamed(gain="gain"),
    "crosstalk": _renamed(matrix="matrix"),
    "time_delay": _renamed(delay="delay"),
    "low_pass": _renamed(cutoff="cutoff_hz"),
    "saturation": _saturation,
    "quantisation": _quantisation,
    "hysteresis": _renamed(width="width"),
    "noise_level": _noise_level,
    "outliers": _outliers,
    "warmup": _warmup,
    "bias_jump": _renamed(time="time", amplitude="amplitude"),
    "temperature_drift": _renamed(per_kelvin="per_kelvin"),
    "cable": _cable,
    "contact": _contact,
    "tool_flexibility": _renamed(frequency="hz", damping_ratio="zeta"),
    "stamp_jitter": _renamed(std="std"),
    "dropped_samples": _renamed(rate="rate"),
    "vibration": _renamed(variance="variance"),
}
"""Conversion by effect; a new effect of the catalogue needs an entry for its parameters to be scored."""
