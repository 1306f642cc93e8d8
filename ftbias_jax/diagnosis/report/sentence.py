"""The headline of a diagnosis in forty words: what was found with its value, its share of the error, and what to do."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import product

import numpy as np

from ftbias_jax.diagnosis.result import Candidate, FoundTerm, Gap, LogGap, Where
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.setup.require import is_draft
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import AXES

MEAN_GAP = 0.01
"""Noise sigmas by which the error must exceed noise alone for a sentence about it."""
SMALL = 0.1
"""Noise sigmas beyond noise alone up to which a gap is called small."""
MOST_WORDS = 40
"""Largest number of words: an engineer reads the first line only."""
FEW_WORDS = 6
"""Words of a remedy beyond which only its first clause is taken."""
FORCE, TORQUE = slice(0, 3), slice(3, 6)
Found = Candidate | FoundTerm


def headline(
    verdict: str,
    gap: Gap,
    found: Sequence[Found],
    candidates: Sequence[Candidate] = (),
    where: Where | None = None,
) -> str:
    """What was found, in this order, the error before and after it in N or Nm, and what to do; errors are held-out rms.

    Statements of the causes' twins are among those of all candidates. For an unexplained gap its location is stated.
    """
    if verdict == "none":
        return f"The log agrees with the setup: {_error(gap)}. Nothing to do."
    if verdict == "unknown" or not found:
        return _unexplained(gap, found, where)
    twins = {candidate.effect: candidate.statement for candidate in candidates if candidate.statement}
    actions, worths = _what_to_do(found), (_worth(verdict, gap), _worth(verdict, gap, short=True))
    for said, worth, action in product(_from_long_to_short(found, twins), worths, actions):
        text = f"{_capital(said)}: {worth}. {action}"
        if len(text.split()) <= MOST_WORDS:
            break
    return text


def disagreement(by_log: Sequence[LogGap], worse: Sequence[LogGap]) -> str:
    """The headline of logs some of which get ``worse`` by what explains all of them together, or that each need another
    size of it."""
    if not worse:
        return (
            f"The logs do not share one size of {_what_differs(by_log)}. Diagnose them one by one; do not apply this."
        )
    raised = [log for log in worse if log.is_raised]
    errors = [f"of {log.name} from {log.before_sigmas:.2g} to {log.after_sigmas:.2g} noise sigmas" for log in raised]
    does = [f"raises the error {_and(errors)}"] if errors else []
    does += [f"contradicts {log.name}" for log in worse if log not in raised]
    odd = max(by_log, key=lambda log: log.before_sigmas).name
    return (
        f"The logs do not share one cause: what explains them together {_and(does)}. "
        f"Diagnose them one by one, {odd} first; do not apply this."
    )


def _what_differs(by_log: Sequence[LogGap]) -> str:
    """Names of the causes, and the size of the first one in the logs where it differs most, if it is a number."""
    names = _and(by_log[0].parameters)
    effect, numbers = next(iter(by_log[0].parameters.items()))
    name = next((name for name, value in numbers.items() if isinstance(value, float)), None)
    if name is None:
        return names
    sizes = (np.array([log.parameters[effect][name], log.stderr[effect][name]], float) for log in by_log)
    smallest, *_, largest = sorted(zip(sizes, by_log, strict=True), key=lambda one: float(one[0][0]))
    ends = " and ".join(f"{value_words(*size)} in {log.name}" for size, log in (smallest, largest))
    return f"{names}: {name} {ends}"


def no_free_motion(gap: Gap, seconds: float) -> str:
    """The headline of logs in which the tool is in contact from the first second to the last."""
    return (
        f"Something touches the tool from 0 to {seconds:.1f} s: no free motion, so no other effect can be identified. "
        f"{_capital(_error(gap))}. Record some seconds of free motion, or tare."
    )


def _from_long_to_short(found: Sequence[Found], twins: dict[str, str]) -> Iterator[str]:
    """What was found, from long to short: with twins' statements, with their names, without, and the first alone."""
    plain = list(map(_plain, found))
    for say in (twins, {}):
        yield _and(words + _alike(one, say) for words, one in zip(plain, found, strict=True))
    yield _and(plain)
    if len(plain) > 1:
        names = Counter(one.title if isinstance(one, Candidate) else f"term of {one.drive}" for one in found[1:])
        yield f"{plain[0]}, and {_and(map(_counted, names, names.values()))}"
        yield f"{plain[0]}, and {len(found) - 1} more"


def _counted(name: str, number: int) -> str:
    terms = name.startswith("term of ")
    return f"{number} {name.replace('term', 'terms', 1)}" if number > 1 and terms else f"a {name}" if terms else name


def _plain(one: Found) -> str:
    return one.statement or (one.title if isinstance(one, Candidate) else one.text)


def _alike(one: Found, say: dict[str, str]) -> str:
    """What a term resembles, or the first twin of a cause in brackets, by its own statement or its name."""
    if isinstance(one, FoundTerm):
        return f", like {one.resembles[0]}" if one.resembles else ""
    if not one.indistinguishable_from:
        return ""
    twin, *others = one.indistinguishable_from
    return f" (or {say.get(twin, twin)}{f', or {len(others)} more' if others else ''})"


def _and(parts: Iterable[str]) -> str:
    *most, last = parts
    return f"{', '.join(most)}, and {last}" if most else last


def _worth(verdict: str, gap: Gap, short: bool = False) -> str:
    """How far the error falls, in words."""
    if gap.before_sigmas - 1 < MEAN_GAP:
        return "the mean reading agrees with the setup"
    if verdict == "explained" and gap.shrink == 0:
        return "the mean reading departs from the setup by chance only"
    if gap.before_sigmas - 1 < SMALL:
        return f"a small gap, {_error(gap)}"
    sizes, unit = _sizes(gap)
    before, after, noise = (f"{size:.2g}" for size in sizes)
    doubt = "the rest is not explained" if gap.after_sigmas - 1 >= SMALL else "the cause is not certain"
    rest = f"; {doubt}" if verdict == "partly_explained" else ""
    if short:
        return f"the error falls from {before} to {after} {unit} (noise {noise}){rest}"
    return f"the unexplained error falls from {before} {unit} to {after} {unit} (noise {noise} {unit}){rest}"


def _error(gap: Gap) -> str:
    (before, _, noise), unit = _sizes(gap)
    return f"the error is {before:.3g} {unit} where noise alone leaves {noise:.3g} {unit}"


def _unexplained(gap: Gap, found: Sequence[Found], where: Where | None) -> str:
    seen = f" Seen in single samples: {_and(map(_plain, found))}." if found else ""
    channels = sorted(where.channels.items(), key=lambda item: -item[1])[:1] if where else []
    largest = f" {channels[0][0]}" if channels else " the largest channel"
    regime = f" during {where.regimes[0].name}" if where and where.regimes else ""
    text = f"No known effect explains the gap: {_error(gap)}.{seen} Look at{largest}{regime} first."
    return text if len(text.split()) <= MOST_WORDS else text.replace(seen, "")


def _what_to_do(found: Sequence[Found]) -> tuple[str, ...]:
    """Advice from long to short: the first clause of the first remedy, and what the command can do alone."""
    remedies = (one.remedy if isinstance(one, Candidate) else one.check for one in found)
    first = next(filter(None, remedies), "")
    for end in ("[;:]", ", (?=or |and |then )"):
        if len(first.split()) > FEW_WORDS:
            first = re.split(end, first)[0]
    alone = "Add it with --apply."
    return (f"{_capital(first)}, or add it with --apply.", f"{_capital(first)}.", alone) if first else (alone,)


def _sizes(gap: Gap) -> tuple[list[float], str]:
    """rms before, after and of noise alone, for force or torque, whichever departs more from noise; and their unit."""
    force, torque = (
        [_size(rms[group]) for rms in (gap.before_rms, gap.after_rms, gap.noise_floor)] for group in (FORCE, TORQUE)
    )
    departs = [before / max(noise, 1e-12) for before, _, noise in (force, torque)]
    return (torque, "Nm") if departs[1] > departs[0] else (force, "N")


def _size(rms: np.ndarray) -> float:
    """rms over the measured channels."""
    values = rms[np.isfinite(rms)]
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _capital(text: str) -> str:
    """The text with an initial capital letter, unless it starts with the name of a channel."""
    return text if text.startswith(AXES) else f"{text[:1].upper()}{text[1:]}"


def note(setup: Setup, rest: str = "") -> str:
    """What a reader must know besides the headline, in further sentences; the last one is ``at_rest.rest_in_words``."""
    sentences = []
    if setup.sensor.correlated_std is not None and setup.sensor.correlated_std.any():
        sentences.append(
            "The setup's correlated noise is not used here: errors are judged against white noise and drift."
        )
    if is_draft(setup):
        sentences.append(
            "The setup's tool is a draft, so its mass and centre of mass were fitted beside all causes: run ftbias "
            "identify with the setup that --apply writes."
        )
    return " ".join([*sentences, f"{rest[:1].upper()}{rest[1:]}." if rest else ""]).strip()
