# %% [markdown]
# # An effect of your own
#
# A hose drags at the tool with a force against the tool's velocity, like a dashpot between tool and room. The catalogue
# has no such effect. Twenty lines add it; then it is simulated, found by the diagnosis, and removed from the bias.

# %%
import matplotlib

matplotlib.use("Agg")  # leave this line out in a notebook
import matplotlib.pyplot as plt

import ftbias_jax as ft


def drag(values, signals, wrench):
    force = -values["coefficient"] * signals.path.velocity  # (T, 3) N, base axes, on the tool
    return wrench + signals.push(force)


hose_drag = ft.Effect(
    "hose_drag",
    "environment",
    (ft.Parameter("coefficient", "N s/m", "force per velocity of the sensor", lower=0, scale=5.0),),
    "a hose drags at the tool, the faster the more",
    "route the hose so that it moves freely",
    reading=drag,
)

# %% [markdown]
# ## Simulate a log with the effect

# %%
setup = ft.parse_setup(
    {
        "robot": {"model": "panda"},
        "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.9, "center_of_mass": [0.01, -0.005, 0.06], "inertia": [2.5e-3, 0, 0, 2.2e-3, 0, 1.1e-3]},
        "bias": {"noise_density": [2e-3, 1e-4]},
    }
)
simulated = ft.simulate(setup, {"hose_drag": {"coefficient": 4.0}}, own=[hose_drag], duration=20, rate=100, seed=2)

# %% [markdown]
# ## Find the effect

# %%
diagnosis = ft.diagnose(setup, [simulated.log], effects=[hose_drag])
print(diagnosis)
(cause,) = diagnosis.causes
assert cause.effect == "hose_drag"
assert abs(cause.parameters["coefficient"] - 4.0) < 3 * cause.stderr["coefficient"]

# %% [markdown]
# ## Correct the bias
#
# `fixed` has the section `[effects.hose_drag]` and the definition of the effect. A setup file has only the section, so
# pass the definition when you load it: `ft.load_setup("fixed.toml", effects=[hose_drag])`.

# %%
fixed = diagnosis.apply(setup)
before, after = (ft.filter_log(one, simulated.log) for one in (setup, fixed))

figure, ax = plt.subplots(figsize=(8, 3))
for result, name in ((before, "without the effect"), (after, "with it")):
    ax.plot(result.t, result.bias[:, 0] - simulated.truth.bias[:, 0], label=name)
ax.set_xlabel("t [s]")
ax.set_ylabel("error of the bias fx [N]")
ax.legend()
figure.savefig("own_effect.png", dpi=110)
