"""What an effect says in one sentence when it was found: a quantity, its unit, and what the setup states instead.

A statement is a function of the estimates of an effect's parameters. Entries of the catalogue take one of these forms.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.types import AXES, AXIS_UNITS, Array

USUAL = np.repeat([1.0, 0.04], 3)
"""N, Nm: forces and torques that weigh alike."""
SURE = 3.0
"""Standard errors from which on a channel is mentioned, and within which channels are called equal."""
PERCENT, DEGREES = 100.0, 180 / np.pi


class Estimate(NamedTuple):
    """One parameter; arrays of the parameter's shape."""

    value: Array
    stderr: Array
    """NaN = not known."""
    nominal: Array
    """What the setup states, NaN = nothing."""


Estimates = Mapping[str, Estimate]
Statement = Callable[[Estimates], str]


def _form(say: Callable[..., str]) -> Callable[..., Statement]:
    """A form of statements: what it is given apart from the estimates makes a statement."""
    return lambda *given, **named: lambda estimates: say(estimates, *given, **named)


def value_words(value: float, stderr: float) -> str:
    """A number with its standard error, both to the second digit of the error."""
    if not np.isfinite(stderr) or stderr <= 0 or not np.isfinite(value):
        return f"{value:.4g}"
    power = int(np.floor(np.log10(stderr)))
    if power >= -5 and max(abs(value), stderr) < 1e7:
        return f"{value:.{max(1 - power, 0)}f} ± {stderr:.{max(1 - power, 0)}f}"
    digits = max(int(np.floor(np.log10(max(abs(value), stderr)))) - power + 1, 1)
    return f"{value:.{digits}e} ± {stderr:.1e}"


@_form
def amount(
    estimates: Estimates, words: str, name: str, factor: float = 1.0, signs: tuple[str, str] | None = None
) -> str:
    """A parameter that is one number, times a factor: {value} in the words, {setup} for what the setup states, {sign}.

    With signs, words for positive and for negative values, {value} is the size; without, it has its own sign.
    """
    value, stderr, nominal = (factor * float(np.asarray(x).ravel()[0]) for x in estimates[name])
    setup = f", the setup says {nominal:.4g}" if np.isfinite(nominal) else ""
    sign = "" if signs is None else signs[value < 0]
    return _filled(words, estimates, value=value_words(abs(value) if signs else value, stderr), setup=setup, sign=sign)


@_form
def distance(
    estimates: Estimates, words: str, name: str, unit: str, factor: float = 1.0, labels: Sequence[str] = "xyz"
) -> str:
    """How far a vector is from what the setup states, or from zero: {value}, in a unit of the given factor.

    The {axis} is the label of the one along which it departs most.
    """
    value, stderr, nominal = estimates[name]
    away = factor * (value - np.where(np.isfinite(nominal), nominal, 0))
    length = max(float(np.linalg.norm(away)), 1e-300)
    error = factor * float(np.sqrt(np.sum((away / length * stderr) ** 2)))
    return words.format(value=f"{value_words(length, error)} {unit}", axis=labels[int(np.argmax(np.abs(away)))])


@_form
def angle(estimates: Estimates, words: str, name: str) -> str:
    """The angle between a vector and the one that the setup states, in degrees; {value} of the words."""
    value, stderr, nominal = estimates[name]
    between = np.arctan2(np.linalg.norm(np.cross(nominal, value)), nominal @ value)
    error = np.linalg.norm(stderr) / np.sqrt(2) / max(np.linalg.norm(value), 1e-300)
    return words.format(value=f"{value_words(float(np.degrees(between)), float(np.degrees(error)))} deg")


@_form
def channels(
    estimates: Estimates,
    words: str,
    name: str,
    neutral: float = 0.0,
    unit: str = "{unit}",
    factor: float = 1.0,
    exact: bool = False,
) -> str:
    """A parameter with a number for each channel: the surest force, or else torque, or all if they are equal.

    Words may have {value}, {channel}, {verb}, and {sign}: "much" above neutral or "little" below. The unit, of the
    given factor, may have {unit} = N or Nm; what is exact is read off, without an error to speak of.
    """
    value, stderr = (np.asarray(x, float).reshape(-1, len(AXES))[-1] for x in estimates[name][:2])
    away = np.where(np.isfinite(value), value - neutral, 0)
    size = np.where(stderr > 0, stderr, USUAL)
    sure = np.abs(away) > SURE * size if (stderr > 0).any() else away != 0
    preferred = sure & (USUAL[0] == USUAL) if sure[:3].any() else sure
    largest = int(np.argmax(np.where(preferred, np.abs(away) / size, -1)))
    spread = np.abs(away - away[largest]) / size
    which, shown = AXES[largest], unit.format(unit=AXIS_UNITS[largest])
    if sure.all() and (spread < SURE).all() and unit == "%":
        which = "all six channels"
    elif sure.sum() > 1:
        which += f" and {'others' if sure.sum() > 2 else next(a for a in AXES if sure[AXES.index(a)] and a != which)}"
    error = np.nan if exact else factor * float(stderr[largest])
    value_shown = value_words(factor * abs(float(away[largest])), error)
    verb = "reads" if which in AXES else "read"
    sign = "much" if away[largest] > 0 else "little"
    return _filled(words, estimates, value=f"{value_shown} {shown}".rstrip(), channel=which, sign=sign, verb=verb)


@_form
def leak(estimates: Estimates, words: str, name: str) -> str:
    """The surest entry beside the diagonal of a matrix (6, 6); {value}, {source} and {target} of the words."""
    value, stderr = (np.asarray(x, float) for x in estimates[name][:2])
    size = np.abs(value - np.diag(np.diag(value)))
    surest = np.divide(size, stderr, out=np.zeros_like(size), where=stderr > 0)
    relative = size * USUAL / USUAL[:, None]
    row, column = np.unravel_index(int(np.argmax(surest if surest.any() else relative)), size.shape)
    same = AXIS_UNITS[row] == AXIS_UNITS[column]
    factor = PERCENT if same else 1.0
    shown = value_words(factor * float(value[row, column]), factor * float(stderr[row, column]))
    unit = "%" if same else f"{AXIS_UNITS[row]} per {AXIS_UNITS[column]}"
    return words.format(value=f"{shown} {unit}", source=AXES[column], target=AXES[row])


@_form
def events(estimates: Estimates, words: str, name: str, start: str) -> str:
    """Forces (N, 3) that last for a while: the largest, how many, and when the first began."""
    sizes = np.linalg.norm(np.asarray(estimates[name].value, float).reshape(-1, 3), axis=1)
    begins = np.asarray(estimates[start].value, float).ravel()
    times = "once" if len(sizes) == 1 else f"{len(sizes)} times"
    first = f"{begins.min(initial=np.inf):.4g} s"
    return words.format(value=f"{sizes.max(initial=0.0):.3g} N", times=times, first=first)


@_form
def growth(estimates: Estimates, words: str, name: str) -> str:
    """Variance per squared speed (n, 6): the standard deviation at 1 rad/s, of every joint, where it is largest."""
    total = np.sqrt(np.nansum(np.asarray(estimates[name].value, float).reshape(-1, len(AXES)), 0))
    largest = int(np.argmax(total / USUAL))
    return words.format(value=f"{total[largest]:.2g} {AXIS_UNITS[largest]}", channel=AXES[largest])


def _filled(words: str, estimates: Estimates, **own: str) -> str:
    """The words with the first numbers of the parameters by name, and what a form makes of them."""
    numbers = {name: float(np.ravel(x.value)[0]) for name, x in estimates.items() if np.size(x.value)}
    return words.format(**{**numbers, **own})
