"""The physics of each withheld kind, in the reading of MuJoCo's sensors, against an independent formula."""

from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.model.effects.catalogue import CATALOGUE
from validation.generator import recording
from validation.generator.effects import catalogue, effect
from validation.generator.kinds.plan import ALL_ALONG, KINDS, chosen
from validation.generator.world import tool_path, wrench

DRIVES = (
    *("constant", "time", "temperature", "position", "orientation", "velocity", "angular_velocity", "acceleration"),
    *("joint_angle", "joint_velocity", "load", "load_time", "frequency", "noise"),
)
BOTH = [(name, form) for name, kind in KINDS.items() for form in kind.forms]


@pytest.fixture(scope="module")
def scene():
    """A scene with three seconds of brisk motion."""
    made = recording.random_scene("sines", 3.0, 250.0, 1.5, np.random.SeedSequence(3).spawn(4))
    assert made.belief.arm.name
    return made


@pytest.fixture(scope="module")
def path(scene):
    return tool_path(scene.world, scene.motion, scene.grid)


def made(name, form, scene, scale=1.0):
    """Parameters of a kind, and its effect in a scene."""
    kind = KINDS[name]
    parameters = kind.draw(form, effect.Draw(np.random.default_rng(1), 1, scale), scene)
    return parameters, kind.build(form, parameters, scene)


def each(name, scene):
    """Form, parameters and effect of a kind, for one form after the other."""
    return ((form, *made(name, form, scene)) for form in KINDS[name].forms)


def pushed(one, scene):
    """(S, 6) change of MuJoCo's reading by a mechanical effect, on the grid."""
    return wrench(one.world(scene.world), scene.motion, scene.grid) - scene.nominal


def reading_of(path, force, point, torque=0.0):
    """(S, 6) change of the reading by a force (base frame) at a point (tool frame) and a torque (base frame)."""
    turned = path.rotation.transpose(0, 2, 1)
    arm = path.rotation @ np.asarray(point, float)
    about = np.cross(arm, force) + torque
    return -np.concatenate([np.einsum("tij,tj->ti", turned, x) for x in (force + 0 * arm, about)], 1)


def in_base(path, seen):
    """(S, 3) base frame: the force or torque on the tool that causes a reading (S, 3)."""
    return -np.einsum("tij,tj->ti", path.rotation, seen)


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def test_every_drive_has_a_kind_that_is_seen_and_one_that_is_not():
    assert sorted(kind.drive for kind in ALL_ALONG.values()) == sorted(2 * list(DRIVES))
    for which in ("seen", "unseen"):
        assert sorted(KINDS[name].drive for name in chosen(which)) == sorted(DRIVES)
    assert set(chosen("all")) == set(ALL_ALONG)
    assert set(chosen("events")) == set(KINDS) - set(ALL_ALONG)


def test_no_kind_is_in_a_catalogue_and_its_words_are_known():
    assert not set(KINDS) & (set(CATALOGUE) | set(catalogue.ENTRIES))
    for kind in KINDS.values():
        assert len(set(kind.forms)) == 2
        assert kind.frame in ("base", "sensor", "joint", "none")
        assert kind.acts_as in ("force", "torque", "wrench", "bias", "noise")
        others = {*kind.equivalent, *kind.sometimes, *(x for more in kind.equivalent_forms.values() for x in more)}
        assert others <= set(DRIVES) - {kind.drive}
        assert set(kind.equivalent_forms) <= set(kind.forms)
        assert set(kind.twins) <= set(CATALOGUE)


@pytest.mark.parametrize(("name", "form"), BOTH)
def test_parameters_say_all_and_coefficients_are_numbers(scene, name, form):
    """Equal parameters in the same scene give the same effect; they contain only numbers, words and lists."""
    parameters, one = made(name, form, scene)
    assert one.name == name
    assert one.form == form
    assert one.parameters == parameters
    assert all(isinstance(x, float | int | list) for x in parameters.values())
    for value in KINDS[name].coefficients(form, parameters).values():
        assert np.isfinite(value).all()


def test_wind_and_balancer_are_forces_of_one_size(scene, path):
    for form, p, one in each("wind", scene):
        expected = reading_of(path, np.array(p["force"]), p["point"], np.array(p.get("couple", np.zeros(3))))
        np.testing.assert_allclose(pushed(one, scene), expected, atol=1e-9)
        assert ("couple" in p) == (form == "with_couple")
    for form, p, one in each("balancer", scene):
        rope = np.array(p["hook"]) - path.points(np.array(p["point"])) if form == "fixed_hook" else p["direction"]
        expected = reading_of(path, p["tension"] * unit(np.array(rope)), p["point"])
        np.testing.assert_allclose(pushed(one, scene), expected, atol=1e-9)


@pytest.mark.parametrize(("form", "power"), [("inverse_square", 2), ("inverse_fourth", 4)])
def test_a_magnet_pulls_to_its_place_and_fades_with_the_power_of_the_distance(scene, path, form, power):
    p, one = made("magnet_bar", form, scene)
    p = p | {"core": 1e-3}
    one = KINDS["magnet_bar"].build(form, p, scene)
    away = np.array(p["source"]) - path.points(np.array(p["point"]))
    distance = np.linalg.norm(away, axis=1)
    seen = pushed(one, scene)
    strength = -(seen[:, :3] * np.einsum("tij,ti->tj", path.rotation, unit(away))).sum(1)
    far = distance > 0.03
    np.testing.assert_allclose((strength * distance**power)[far], (strength * distance**power)[far].mean(), rtol=5e-3)
    np.testing.assert_allclose(seen, reading_of(path, strength[:, None] * unit(away), p["point"]), atol=1e-7)


def test_a_rail_pulls_across_itself_and_not_along(scene, path):
    for _, p, one in each("rail", scene):
        force = in_base(path, pushed(one, scene)[:, :3])
        away = np.array(p["source"]) - path.points(np.array(p["point"]))
        assert np.abs(force @ np.array(p["along"])).max() < 1e-9
        assert ((force * away).sum(1) > 0).all()


@pytest.mark.parametrize("form", KINDS["sag"].forms)
def test_sag_turns_the_weight_and_leaves_the_force(scene, path, form):
    p, one = made("sag", form, scene)
    seen, gravity = pushed(one, scene), scene.belief.gravity
    assert np.abs(seen[:, :3]).max() < 1e-9
    down = np.einsum("tij,i->tj", path.rotation, unit(gravity))
    shift = np.array(p["shift"]) * (down if form == "elastic" else np.tanh(5 * down))
    expected = -np.cross(shift, scene.belief.tool.mass * np.linalg.norm(gravity) * down)
    np.testing.assert_allclose(seen[:, 3:], expected, atol=1e-9)


def test_a_compass_is_turned_across_the_field_and_soft_iron_has_two_like_ends(scene, path):
    for form, p, one in each("compass", scene):
        torque = in_base(path, pushed(one, scene)[:, 3:])
        cosine = path.rotation @ np.array(p["axis"]) @ np.array(p["field"])
        sine = np.sqrt(1 - cosine**2)
        size = p["torque"] * (sine if form == "permanent" else 2 * np.abs(cosine) * sine)
        np.testing.assert_allclose(np.linalg.norm(torque, axis=1), size, atol=1e-9)
        assert np.abs(torque @ np.array(p["field"])).max() < 1e-9


@pytest.mark.parametrize(("name", "form"), [(x, form) for x in ("hose", "trailing") for form in KINDS[x].forms])
def test_what_is_dragged_resists_the_velocity(scene, path, name, form):
    p, one = made(name, form, scene)
    v = np.gradient(path.points(np.array(p["point"])), path.t, axis=0)
    speed = np.linalg.norm(v, axis=1)
    force = in_base(path, pushed(one, scene)[:, :3])
    size = {
        "viscous": lambda: p["drag"] * speed,
        "turbulent": lambda: p["drag"] * speed**2,
        "coulomb": lambda: p["friction"] * speed / np.hypot(speed, 0.005),
        "stribeck": lambda: p["friction"] * (1 + np.exp(-((speed / 0.1) ** 2))) * speed / np.hypot(speed, 0.005),
    }[form]()
    np.testing.assert_allclose((force * v).sum(1), -size * speed, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), size, atol=1e-8)


def test_a_spindle_needs_omega_cross_its_momentum_and_answers_to_its_own_acceleration(scene, path):
    for form, p, one in each("spindle", scene):
        phase = 2 * np.pi / p["period"] * path.t
        swing = 0.5 if form == "surging" else 0.0
        h = p["momentum"] * (1 + swing * np.sin(phase))[:, None] * np.array(p["axis"])
        faster = swing * p["momentum"] * 2 * np.pi / p["period"] * np.cos(phase)[:, None] * np.array(p["axis"])
        omega = np.einsum("tij,ti->tj", path.rotation, path.angular_velocity())
        seen = pushed(one, scene)[5:-5]
        np.testing.assert_allclose(seen[:, 3:], (np.cross(omega, h) + faster)[5:-5], atol=2e-5)
        assert np.abs(seen[:, :3]).max() < 1e-6


def test_a_brake_dissipates_and_water_carried_along_resists_acceleration(scene, path):
    omega = path.angular_velocity()
    for form, p, one in each("eddy_brake", scene):
        factor = 1.0 if form == "linear" else np.linalg.norm(omega, axis=1, keepdims=True)
        seen = pushed(one, scene)
        np.testing.assert_allclose(
            seen, reading_of(path, np.zeros(3), np.zeros(3), -p["damping"] * factor * omega), atol=1e-9
        )
    for form, p, one in each("entrained", scene):
        a = np.gradient(np.gradient(path.points(np.array(p["point"])), path.t, axis=0), path.t, axis=0)
        normal = path.rotation @ np.array(p["normal"])
        a = a if form == "sphere" else (a * normal).sum(1, keepdims=True) * normal
        np.testing.assert_allclose(pushed(one, scene), reading_of(path, -p["mass"] * a, p["point"]), atol=1e-8)


@pytest.mark.parametrize("form", KINDS["dangling"].forms)
def test_what_dangles_goes_on_swinging_at_its_frequency_when_the_robot_stops(scene, form):
    start, stop, home = 0.2, 0.6, scene.belief.arm.home

    def motion(t):
        x = np.clip((t - start) / (stop - start), 0, 1)[:, None]
        step, rate = x**3 * (10 - 15 * x + 6 * x**2), 30 * (x * (1 - x)) ** 2 / (stop - start)
        return home + 0.03 * step, 0.03 * rate * np.ones_like(home), np.gradient(0.03 * rate, t, axis=0) + 0 * home

    still = replace(scene, motion=motion, nominal=wrench(scene.world, motion, scene.grid))
    p = {"share": 0.5, "hz": 1.7, "zeta": 0.03}
    seen = pushed(KINDS["dangling"].build(form, p, still), still)
    assert np.abs(seen[scene.grid < start - 0.01]).max() < 2e-3 * np.abs(seen).max()
    rest = seen[scene.grid > stop, :3]
    rest = (rest - rest.mean(0))[:, np.abs(rest).max(0).argmax()]
    crossings = scene.grid[scene.grid > stop][np.flatnonzero(np.diff(np.sign(rest - rest.mean())))]
    assert 0.5 / np.median(np.diff(crossings)) == pytest.approx(p["hz"], rel=0.1)


def test_a_dispenser_loses_weight_and_inertia(scene, path):
    for form, p, one in each("dispenser", scene):
        t = np.maximum(path.t, 0)
        gone = p["loss"] * (t / 30 if form == "steady" else 1 - np.exp(-t / p["tau"]))
        a = path.acceleration(np.array(p["point"]))
        expected = reading_of(path, gone[:, None] * (a - scene.belief.gravity), p["point"])
        np.testing.assert_allclose(pushed(one, scene), expected, atol=1e-8)


def rotation_at(angle, scene):
    """(3, 3) rotation of the tool with the last joint at that angle."""
    q = np.array([[*scene.belief.arm.home[:-1], angle]])
    return tool_path(scene.world, lambda t: (q, 0 * q, 0 * q), np.zeros(1)).rotation[0]


@pytest.mark.parametrize(("name", "form"), [(x, form) for x in ("bundle", "seal") for form in KINDS[x].forms])
def test_bundle_and_seal_turn_about_the_last_joint(scene, name, form):
    """Their torque is about the axis of the last joint, so it does no work on the other joints."""
    p, one = made(name, form, scene)
    q, dq, _ = scene.motion(scene.grid)
    twist = q[:, -1] - p.get("relaxed", 0)
    size = {
        "linear": lambda: p["stiffness"] * twist,
        "stiffening": lambda: p["stiffness"] * twist**3,
        "viscous": lambda: p["friction"] * dq[:, -1],
        "dry": lambda: p["friction"] * np.tanh(dq[:, -1] / 0.01),
    }[form]()
    seen = pushed(one, scene)
    assert np.abs(seen[:, :3]).max() < 1e-9
    spin = rotation_at(0.0, scene).T @ rotation_at(1e-6, scene)
    axis = np.array([spin[2, 1], spin[0, 2], spin[1, 0]]) / 1e-6
    np.testing.assert_allclose(seen[:, 3:], size[:, None] * axis, atol=1e-6)


def test_cogging_is_periodic_in_one_joint(scene):
    for form, p, one in each("cogging", scene):
        seen = one.sensor(scene.nominal) - scene.nominal
        angle = p["per_turn"] * scene.motion(scene.grid)[0][:, p["joint"] - 1]
        columns = np.stack([np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], 1)
        found = np.linalg.lstsq(columns, seen, rcond=None)[0]
        np.testing.assert_allclose(columns @ found, seen, atol=1e-9)
        np.testing.assert_allclose(found[:2], [p["cosine"], p["sine"]], atol=1e-9)
        assert (np.abs(found[2:]).max() > 0.01) == (form == "two_harmonics")


def test_warm_motors_obey_the_equation_of_heat(scene):
    for form, p, one in each("warm_motors", scene):
        t = scene.stamps
        squared = scene.motion(t)[1] ** 2
        power = squared.sum(1) if form == "all_joints" else squared[:, p["joint"] - 1]
        heat = one.slow(t)[:, 0] / p["amplitude"][0]
        np.testing.assert_allclose(
            np.diff(heat) / np.diff(t), ((power - heat) / p["tau"])[1:], atol=0.02 * power.max() / p["tau"]
        )


def test_gauges_that_bend_do_so_by_the_load(scene):
    w = scene.nominal
    bent = [(name, form) for name, form in BOTH if KINDS[name].drive == "load"]
    added = {form: made(name, form, scene)[1].sensor(w) - w for name, form in bent}
    soft, lopsided = made("soft_gauge", "cubic", scene)[0], made("lopsided", "dead_zone", scene)[0]
    share, top = np.array(soft["share"]), np.array(soft["load"])
    np.testing.assert_allclose(added["cubic"], share * w**3 / top**2, atol=1e-12)
    np.testing.assert_allclose(added["quadratic"], share * w * np.abs(w) / top, atol=1e-12)
    assert (added["pull_and_push"][w < 0] == 0).all()
    np.testing.assert_allclose(added["pull_and_push"] / w, np.where(w > 0, lopsided["share"], 0), atol=1e-9)
    zone = np.array(lopsided["zone"])
    assert (np.abs(w + added["dead_zone"]) < np.abs(w)).all()
    far = np.abs(w) > 4 * zone
    np.testing.assert_allclose(np.abs(added["dead_zone"])[far], (zone + 0 * w)[far], rtol=2e-3)


@pytest.mark.parametrize("name", ["ageing", "supply", "warm_gauge"])
def test_a_sensitivity_that_changes_scales_the_load(scene, name):
    for form, p, one in each(name, scene):
        factor = one.sensor(np.ones_like(scene.nominal))
        np.testing.assert_allclose(one.sensor(scene.nominal), factor * scene.nominal)
        course = (factor - 1) / np.broadcast_to(p.get("share", p.get("per_kelvin")), 6)
        np.testing.assert_allclose(course, course[:, :1] + 0 * course, atol=1e-9)
        t, kelvin = np.maximum(scene.grid, 0), scene.temperature(scene.grid) - 25
        expected = {
            ("ageing", "linear"): t / 30,
            ("ageing", "settling"): 1 - np.exp(-t / p.get("tau", 1)),
            ("supply", "wave"): np.sin(2 * np.pi * scene.grid / p.get("period", 1)),
            ("supply", "step"): np.where(scene.grid > p.get("time", 0), 1.0, 0.0),
            ("warm_gauge", "linear"): kelvin,
            ("warm_gauge", "square"): kelvin**2 / 10,
        }[name, form]
        near_the_step = np.abs(scene.grid - p["time"]) < 0.8 if form == "step" else np.zeros(len(t), bool)
        np.testing.assert_allclose(course[~near_the_step, 0], expected[~near_the_step], atol=1e-3)


def test_a_bias_follows_time_temperature_or_the_mains(scene):
    t = np.arange(0, 40, 0.001)
    for _, p, one in each("regulator", scene):
        np.testing.assert_allclose(one.slow(t + p["period"]), one.slow(t), atol=1e-9)
        np.testing.assert_allclose(np.abs(one.slow(t)).max(0), np.abs(p["amplitude"]), rtol=1e-3)
    constant = replace(scene, temperature=lambda t: np.full(len(t), 31.0))
    p, _ = made("warm_side", "square", constant)
    assert np.abs(KINDS["warm_side"].build("gradient", p, constant).slow(t)).max() < 1e-12
    warm = KINDS["warm_side"].build("square", p, constant).slow(t)
    np.testing.assert_allclose(warm, 3.6 * np.array(p["per_kelvin"]) + 0 * warm)
    for form, p, one in each("hum", scene):
        power = np.abs(np.fft.rfft(one.slow(t)[:, 0] * np.hanning(len(t))))
        hz = np.fft.rfftfreq(len(t), 0.001)
        assert hz[power.argmax()] == pytest.approx(p["hz"], abs=0.05)
        third = power[np.abs(hz - 3 * p["hz"]) < 0.05].max() / power.max()
        assert third == pytest.approx(0.4 if form == "third_harmonic" else 0.0, abs=0.05)


def test_a_pump_pushes_along_one_line_at_its_frequency(scene, path):
    for form, p, one in each("pump", scene):
        force = in_base(path, pushed(one, scene)[:, :3])
        wave = force @ np.array(p["force"]) / np.dot(p["force"], p["force"])
        np.testing.assert_allclose(force, wave[:, None] * np.array(p["force"]), atol=1e-9)
        ups = path.t[:-1][(wave[:-1] < 0) & (wave[1:] >= 0)]
        assert 1 / np.diff(ups).mean() == pytest.approx(p["hz"], rel=1e-2)
        assert (np.abs(wave) > 0.8).mean() == pytest.approx(0.71 if form == "strokes" else 0.41, abs=0.04)


def test_noise_follows_the_load_or_the_time_and_never_falls_below_what_is_stated(scene):
    for name in ("rough_bridge", "radio"):
        for form in KINDS[name].forms:
            p, one = made(name, form, scene)
            scale = one.noise(np.ones((len(scene.stamps), 6)))
            assert scale.min() >= 1
            if name == "rough_bridge":
                w = np.stack([np.interp(scene.stamps, scene.grid, x) for x in scene.nominal.T], 1)
                load = np.abs(w) if form == "each_channel" else np.linalg.norm(w[:, :3], axis=1)[:, None] + 0 * w
                ratio = np.sqrt(scale**2 - 1) / load
                np.testing.assert_allclose(ratio, ratio[:1] + 0 * ratio, rtol=1e-6)
                np.testing.assert_allclose((scale**2 - 1).mean(0), p["growth"] ** 2)
            elif form == "rising":
                assert (np.diff(scale[:, 0]) > 0).all()
            else:
                assert set(np.round(scale[:, 0], 6)) == {1.0, round(float(np.sqrt(1 + 4 * p["growth"] ** 2)), 6)}


@pytest.mark.parametrize("form", KINDS["gripped"].forms)
def test_what_is_gripped_is_a_mass_at_its_point_while_it_is_held(scene, path, form):
    p, one = made("gripped", form, scene)
    weight = p["mass"] * (scene.belief.gravity - path.acceleration(np.array(p["point"])))
    held, seen = reading_of(path, weight, p["point"]), pushed(one, scene)
    times = np.array(p["at"])
    away = np.abs(path.t[:, None] - times).min(1) > p["lift"]
    carried = (path.t[:, None] > times).sum(1) % 2 == 1
    np.testing.assert_allclose(seen[away & carried], held[away & carried], atol=1e-9)
    assert not seen[away & ~carried].any()
    assert (np.diff(times) > 0).all()


@pytest.mark.parametrize("form", KINDS["switched"].forms)
def test_what_is_switched_stays_in_the_tool_and_is_on_every_other_time(scene, path, form):
    p, one = made("switched", form, scene)
    seen = pushed(one, scene)
    on = np.isclose(np.linalg.norm(seen, axis=1), np.linalg.norm(seen, axis=1).max(), atol=1e-9)
    changed = path.t[1:][np.diff(on.astype(int)) != 0]
    np.testing.assert_allclose(changed, p["at"], atol=2e-3)
    assert np.ptp(seen[on], axis=0).max() < 1e-9
    assert seen[:, :3].any() == (form == "force")


def test_a_thicket_holds_back_near_its_middle_only(scene, path):
    for _, p, one in each("thicket", scene):
        force, v = in_base(path, pushed(one, scene)[:, :3]), path.velocity(np.array(p["point"]))
        far = np.linalg.norm(path.points(np.array(p["point"])) - p["middle"], axis=1) > 2 * p["reach"]
        assert ((force * v).sum(1) <= 1e-12).all()
        assert np.abs(force[far]).max(initial=0.0) < 1e-6
        assert np.abs(force).max() > 0.01


def test_a_bench_pushes_out_along_its_normal_and_holds_back_along_itself(scene, path):
    for _, p, one in each("bench", scene):
        normal, at = np.array(p["normal"]), path.points(np.array(p["point"]))
        force, v = in_base(path, pushed(one, scene)[:, :3]), path.velocity(np.array(p["point"]))
        depth, out = at @ normal - p["offset"], force @ normal
        assert np.abs(force[depth < 0]).max() < 1e-9
        assert (out[depth > 1e-6] < 0).all()
        along = force - out[:, None] * normal
        assert ((along * v).sum(1) <= 1e-9).all()
        assert np.linalg.norm(along, axis=1).max() <= p["friction"] * np.abs(out).max() + 1e-9
