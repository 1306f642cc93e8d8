"""The maker of logs: independent of the package, repeatable, and with labels in the catalogue's meaning."""

import ast
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, complete, neutral_values
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import load_setup
from validation import generator, labels
from validation.generator import make, recording
from validation.generator.effects import catalogue, effect
from validation.generator.nominal_model import setup_toml

FOLDER = Path(generator.__file__).parent
DURATION, RATE = 10.0, 100.0
OWN_FORMS = {
    "tool_mass": "point_at_com",
    "tool_com": "any_direction",
    "tool_inertia": "larger",
    "gravity_tilt": "any_direction",
    "mount_rotation": "sensor_axes",
    "encoder_offset": "constant",
    "gain": "scattered",
    "crosstalk": "full",
    "time_delay": "constant",
    "low_pass": "first_order",
    "hysteresis": "play",
    "warmup": "exponential",
    "bias_jump": "step",
    "temperature_drift": "instant",
    "cable": "world",
    "contact": "half_sine",
}
"""The forms that equal those of the catalogue."""


PLUMBING = ("ftbias_jax.errors", "ftbias_jax.io.atomic", "ftbias_jax.runtime.executors")
"""Modules without physics."""


def foreign_imports(source):
    """Modules of the package and of the scoring that a source imports anywhere in it, except those without physics."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names] if node.level == 0 else ["ftbias_jax.up"]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            inside = f"{name}.".startswith("validation.generator.") or name.startswith(PLUMBING)
            if name.split(".")[0] in ("ftbias_jax", "validation") and not inside:
                yield name


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.name)
def test_the_maker_shares_nothing_with_the_package(path):
    """It does not name modules in a way that hides an import, either."""
    source = path.read_text()
    assert list(foreign_imports(source)) == []
    assert "import_module" not in source
    assert "__import__" not in source


def test_the_two_catalogues_have_the_same_names():
    # The generator draws a clock that drifts as a form of time_delay. A sensor that sits elsewhere would change what
    # the seeds of all kept results draw; MuJoCo reads the same of it in test_mend_mjcf.
    drawn = set(CATALOGUE) - {"clock_drift", "mount_translation"}
    assert set(catalogue.LISTED) == drawn == set(labels._CONVERSIONS)
    assert not set(catalogue.UNLISTED) & set(CATALOGUE)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A scene, and the package's model and motion of it, by way of the setup file."""
    seeds = np.random.SeedSequence(5).spawn(4)
    scene = recording.random_scene("sines", DURATION, RATE, 1.2, seeds)
    path = tmp_path_factory.mktemp("setup") / "setup.toml"
    path.write_text(setup_toml(scene.belief))
    params = params_from_setup(load_setup(path))
    q, dq, ddq = (jnp.asarray(x) for x in scene.motion(scene.stamps))
    model = Model(params.arm, params.gravity, params.theta)
    return scene, Signals(jnp.asarray(scene.stamps), q, dq, ddq, jnp.asarray(scene.temperature(scene.stamps)), model)


@pytest.fixture(scope="module")
def package(scene):
    """The package's reading with one effect; one compiled program for all effects."""
    signals = scene[1]
    wanted = [name for name in CATALOGUE if name in OWN_FORMS]
    predict = jax.jit(compose.predict)

    def read(name="", values=None, events=4):
        padded = {}
        for one in wanted:
            entry = CATALOGUE[one]
            padded[one] = neutral_values(entry, signals.model, events)
            if one == name:
                given = complete(entry, values, signals.model)
                padded[one] = {
                    key: jnp.concatenate([x, padded[one][key][len(x) :]]) if -1 in entry.parameter(key).shape else x
                    for key, x in given.items()
                }
        return np.asarray(predict(signals, padded))

    return read


def drawn(name, form, scene):
    """An effect of ordinary size; a contact that does not turn with the tool."""
    for seed in range(20):
        one = catalogue.LISTED[name][0](form, effect.Draw(np.random.default_rng(seed), 1), scene)
        if one.parameters.get("frame", "base") == "base" and len(one.parameters.get("events", ())) <= 4:
            return one
    raise AssertionError(name)


def test_without_effects_both_physics_read_the_same(scene, package):
    """MuJoCo against the package's screws, from the same setup file."""
    clean = recording.noiseless(scene[0], ()).wrench + scene[0].bias
    np.testing.assert_allclose(package(), clean, atol=2e-4 * np.abs(clean).max(0).max())


@pytest.mark.parametrize("name", OWN_FORMS)
def test_a_label_means_to_the_catalogue_what_it_means_to_the_maker(scene, package, tmp_path, name):
    """The label's parameters change the package's reading as they change the maker's."""
    world = scene[0]
    one = drawn(name, OWN_FORMS[name], world)
    timeline = recording.Timeline(None, velocities=True, temperature_every=0)
    entry, _, _ = make.write_log(tmp_path, "log_000", world, [one], timeline, np.random.SeedSequence(1))
    (tmp_path / "truth.json").write_text(json.dumps({"log_000": entry}))
    label = labels.read_labels(tmp_path, ["log_000"])["log_000"]
    values = labels.true_parameters(label, name)
    change = package(name, values) - package()
    expected = recording.noiseless(world, [one]).wrench - recording.noiseless(world, ()).wrench
    late = world.stamps > 3  # filters, delays and loops begin differently
    # The bias absorbs constants: a loop may begin on either side.
    difference, expected = (x[late] - x[late].mean(0) for x in (change - expected, expected))
    assert np.linalg.norm(difference / world.belief.noise_std) < 0.03 * np.linalg.norm(
        expected / world.belief.noise_std
    )
    assert np.isclose(label.gap_sigmas, entry["gap_sigmas"])


def test_vibration_is_as_loud_as_its_label_says(scene):
    """Noise of each form in the fastest tenth of the log, and the catalogue's variance for its own form."""
    world = scene[0]
    white = np.random.default_rng(1).normal(size=(len(world.stamps), 6)) * world.belief.noise_std
    for form in catalogue.LISTED["vibration"][1]:
        one = drawn("vibration", form, world)
        noise = one.noise(white)
        speed = np.abs(np.asarray(scene[1].dq)).sum(1)
        slow, fast = (noise[speed < np.quantile(speed, 0.1)], noise[speed > np.quantile(speed, 0.9)])
        assert (fast.std(0) > 1.4 * slow.std(0)).all(), form
        values = labels.true_parameters(labels.Label({"vibration": one.parameters}, {}, 0.0, (1.0,) * 6), "vibration")
        assert list(values) == (["variance"] if form == "squared" else [])
        if values:
            variance = np.asarray(scene[1].dq) ** 2 @ np.array(values["variance"]) + world.belief.noise_std**2
            np.testing.assert_allclose((noise**2 / variance).mean(0), 1, atol=5 * np.sqrt(2 / len(noise)))


def test_the_same_seed_makes_the_same_logs_in_one_process_or_two(tmp_path):
    limits = make.Limits((3.0, 4.0), (100.0,), False)
    for folder, jobs in (("one", 1), ("two", 2)):
        (tmp_path / folder).mkdir()
        seen = []
        make.make_set(tmp_path / folder, "tool_mass,none,drag", 3, 7, limits, jobs, seen.append)
        assert seen == [1, 2, 3]
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == sorted([f"log_00{i}.{end}" for i in range(3) for end in ("npz", "toml")] + ["truth.json"])
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
