"""Signs in single samples that belong to effects of a catalogue."""

from types import SimpleNamespace

from ftbias_jax.diagnosis.samples.types import Finding, together
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue


def log(**nats):
    """A log in which these signs were detected."""
    return SimpleNamespace(detected=tuple(Finding(sign, True, {}, {}, size, "") for sign, size in nats.items()))


def test_each_effect_comes_from_the_log_that_shows_it_best_and_the_noise_last():
    found = together([log(level=50.0, spikes=9.0), log(spikes=20.0, lost=10.0)])
    assert [(one.effect, one.nats) for one in found] == [
        ("outliers", 20.0),
        ("dropped_samples", 10.0),
        ("noise_level", 50.0),
    ]


def test_a_sign_that_no_effect_leaves_names_nothing():
    without = Catalogue(effect for effect in CATALOGUE.values() if effect.name != "outliers")
    assert together([log(spikes=20.0)], without) == ()
