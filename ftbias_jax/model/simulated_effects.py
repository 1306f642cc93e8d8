"""The effects of a simulation: those of the setup, and others on top."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE, MakeError, check_values, typical_values, values_from_setup
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.terms.parse import flat_numbers
from ftbias_jax.model.effects.types import Model, Values
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.shown import check_shown
from ftbias_jax.setup.types import Setup


def all_values(setup: Setup, effects: Mapping[str, Mapping[str, Any]], model: Model) -> Values:
    """Effects of the setup with others on top, in the catalogue's order; {} stands for typical values."""
    catalogue = catalogue_of_setup(setup)
    checked = check_effects(effects, catalogue=catalogue)
    check_shown(effects, setup, _usage)
    typical = {name: typical_values(catalogue[name], model) for name in effects if name not in checked}
    values = values_from_setup(setup.effects, setup.path, catalogue) | typical | checked
    return {name: values[name] for name in (*catalogue, TERM) if name in values}


def plain(effects: Values) -> Values:
    """Effect -> parameter -> numbers; the numbers of terms are named after the number of their section."""
    return {name: flat_numbers(values) if name == TERM else values for name, values in effects.items()}


def _usage(message: str, field: str = "", remedy: str = "") -> UsageError:
    return UsageError(message, file="effects", field=field, remedy=remedy)


def check_effects(
    effects: Mapping[str, Mapping[str, Any]], error: MakeError = _usage, catalogue: Catalogue = CATALOGUE
) -> Values:
    """Values of the effects that state any; an unknown name, a wrong shape or a value out of bounds is refused."""
    stated = {name: values for name, values in effects.items() if values or name not in catalogue}
    return check_values(stated, error, catalogue=catalogue)
