# %% [markdown]
# # Diagnose a gap
#
# The tool is 70 g heavier than the setup states, so the filter predicts the readings badly. The diagnosis finds the
# cause, and the corrected setup predicts well. Editors and Jupyter (with jupytext) open this script as a notebook.

# %%
import matplotlib

matplotlib.use("Agg")  # leave this line out in a notebook
import matplotlib.pyplot as plt

import ftbias_jax as ft

setup = ft.parse_setup(
    {
        "robot": {"model": "panda"},
        "sensor": {"translation": [0.0, 0.0, 0.04], "noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.9, "center_of_mass": [0.01, -0.005, 0.06], "inertia": [2.5e-3, 0, 0, 2.2e-3, 0, 1.1e-3]},
        "bias": {"noise_density": [2e-3, 1e-4]},
    }
)
simulated = ft.simulate(setup, {"tool_mass": {"mass": 0.97}}, duration=20, rate=125, seed=4)

# %% [markdown]
# ## Filter with the nominal setup
#
# With a correct setup, the innovations would be white and as large as the noise.

# %%
before = ft.filter_log(setup, simulated.log)
print(before)

# %% [markdown]
# ## Find the cause

# %%
diagnosis = ft.diagnose(setup, [simulated.log])
print(diagnosis)
diagnosis.to_html("report.html")
assert [cause.effect for cause in diagnosis.causes] == ["tool_mass"]

# %% [markdown]
# ## Filter with the corrected setup

# %%
fixed = diagnosis.apply(setup)
after = ft.filter_log(fixed, simulated.log)

figure, axes = plt.subplots(2, 1, sharex=True, figsize=(8, 5))
for result, name in ((before, "before"), (after, "after")):
    axes[0].plot(result.t, result.innovation[:, 2], ".", markersize=2, label=name)
    axes[1].plot(result.t, result.bias[:, 2], label=name)
axes[1].plot(simulated.truth.t, simulated.truth.bias[:, 2], "k--", label="truth")
axes[0].set_ylabel("innovation fz [N]")
axes[1].set_ylabel("bias fz [N]")
axes[1].set_xlabel("t [s]")
for ax in axes:
    ax.legend()
figure.savefig("diagnose_a_gap.png", dpi=110)
