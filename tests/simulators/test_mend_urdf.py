from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from made_scenes import URDF as ARM

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import values_from_setup
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup
from ftbias_jax.simulators.mend_urdf import mend_urdf

EFFECTS = {
    "tool_mass": {"mass": 0.9},
    "tool_com": {"center_of_mass": [0.02, 0.01, 0.15]},
    "tool_inertia": {"inertia": [0.003, 1e-4, 0.0, 0.0025, 2e-4, 0.002]},
    **{f"encoder_offset {joint}": {"joint": joint, "offset": 0.03} for joint in (2, 3)},
}


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def setup_of(path, effects=None, **tool):
    tables = {
        "robot": {"urdf": str(path), "tip_link": "flange"},
        "sensor": {"noise_std": [0.1, 0.004], "translation": [0, 0.01, 0.04], "rotation_rpy": [0, 0.2, 3]},
        "tool": tool or {"from_urdf_link": "hand"},
    }
    return replace(parse_setup(tables), effects=effects or {})


def predicted(setup):
    """(T, 6) N, Nm: prediction of the model at the same recorded states."""
    q, dq, ddq = jnp.asarray(np.random.default_rng(0).uniform(-1.5, 1.5, (3, 10, 3)))
    params, t = params_from_setup(setup), jnp.zeros(10)
    signals = Signals(t, q, dq, ddq, t, Model(params.arm, params.gravity, params.theta))
    return compose.predict(signals, jax.tree.map(jnp.asarray, values_from_setup(setup.effects)))


@pytest.mark.parametrize("name", EFFECTS)
def test_a_setup_from_the_mended_file_predicts_what_the_effects_did(urdf, tmp_path, name):
    setup = setup_of(urdf, {name.split()[0]: EFFECTS[name]})
    made = mend_urdf(setup, str(urdf), str(tmp_path / "mended.urdf"))
    (tmp_path / "mended.urdf").write_text(made.files[str(tmp_path / "mended.urdf")])
    assert made.not_expressed == []
    expected = predicted(setup)
    mended = predicted(setup_of(tmp_path / "mended.urdf"))
    scale = np.abs(expected).max()
    assert np.abs(mended - expected).max() < 1e-6 * scale
    assert np.abs(predicted(setup_of(urdf)) - expected).max() > 1e-4 * scale


def test_only_what_must_differ_does(urdf):
    made = mend_urdf(setup_of(urdf), str(urdf), "mended.urdf")
    assert made.files == {"mended.urdf": ARM}
    made = mend_urdf(setup_of(urdf, {"tool_mass": {"mass": 0.9}}), str(urdf), "mended.urdf")
    assert made.files == {"mended.urdf": ARM.replace('value="0.7"', 'value="0.9"')}


def test_offsets_of_joints_need_no_link_of_the_tool(urdf):
    tool = {"mass": 0.7, "center_of_mass": [0, 0, 0.1]}
    effects = {"encoder_offset": {"joint": 2, "offset": 0.03}}
    without = mend_urdf(setup_of(urdf, effects, **tool), str(urdf), "mended.urdf").files["mended.urdf"]
    with_link = mend_urdf(setup_of(urdf, effects), str(urdf), "mended.urdf").files["mended.urdf"]
    assert without == with_link != ARM
    with pytest.raises(SetupError, match="which link is the tool"):
        mend_urdf(setup_of(urdf, effects | {"tool_mass": {"mass": 0.9}}, **tool), str(urdf), "mended.urdf")


def test_mujoco_reads_the_inertia_of_a_link_that_had_none(urdf, tmp_path):
    start, end = ARM.index("    <inertial>"), ARM.index("  </link>\n  <joint")
    urdf.write_text(ARM[:start] + ARM[end:])
    tool = {"mass": 0.9, "center_of_mass": [0.02, 0.01, 0.15], "inertia": [0.003, 1e-4, 0.0, 0.0025, 2e-4, 0.002]}
    made = mend_urdf(setup_of(urdf, **tool), str(urdf), "mended.urdf", "hand").files["mended.urdf"]
    name, compiler = '<robot name="three">', '<compiler fusestatic="false" boundmass="1e-3" boundinertia="1e-6"/>'
    spec = mujoco.MjSpec.from_string(made.replace(name, f"{name}<mujoco>{compiler}</mujoco>"))
    model = spec.compile()
    hand = model.body("hand").id
    assert model.body_mass[hand] == pytest.approx(0.9)
    np.testing.assert_allclose(
        np.sort(model.body_inertia[hand]), np.linalg.eigvalsh([[3e-3, 1e-4, 0], [1e-4, 2.5e-3, 2e-4], [0, 2e-4, 2e-3]])
    )


def test_what_a_urdf_has_no_place_for_is_listed(urdf):
    effects = {"gravity_tilt": {"gravity": [0.0, 0.5, -9.79]}, "low_pass": {"cutoff": 9.0}}
    made = mend_urdf(setup_of(urdf, effects), str(urdf), "mended.urdf")
    assert [one["effect"] for one in made.not_expressed] == ["gravity_tilt"]


def test_the_tools_link_and_the_arm_must_be_known(urdf):
    with pytest.raises(SetupError, match="which link is the tool"):
        mend_urdf(setup_of(urdf, mass=0.7, center_of_mass=[0, 0, 0.1]), str(urdf), "mended.urdf")
    setup = setup_of(urdf)
    with pytest.raises(SetupError, match="is not there"):
        mend_urdf(setup, str(urdf), "mended.urdf", "hund")
    urdf.write_text(ARM.replace('xyz="0.1 0 0" rpy="1.57', 'xyz="0.2 0 0" rpy="1.57'))
    with pytest.raises(SetupError, match="its arm is not the one of the setup"):
        mend_urdf(setup, str(urdf), "mended.urdf")
    built_in = parse_setup(
        {"robot": {"model": "panda"}, "sensor": {"noise_std": 0.1}, "tool": {"mass": 1, "center_of_mass": [0, 0, 0]}}
    )
    with pytest.raises(SetupError, match="is of no URDF"):
        mend_urdf(built_in, str(urdf), "mended.urdf", "hand")
