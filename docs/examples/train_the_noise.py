"""Train the noise of joints, bias and motion on several logs together, and save the resulting setup.

The likelihood is differentiated with respect to the logarithms of the noise, so any optimiser of optax works and no
noise becomes negative. The logs have different lengths and share one compiled program.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import optax

import ftbias_jax as ft
from ftbias_jax.filtering.samples import pad

jax.config.update("jax_enable_x64", True)
# sigma_Q, eta of positions and of velocities, Sigma_D, and the joints' process noise, on which eta depends
TRAINED = ("density", "position_std", "velocity_std", "entries", "process_density")

# In the nominal setup the bias drifts five times too fast, the encoders are four times too noisy, and the motion of the
# sensor is known inaccurately. The logs come from the true setup.
truth = ft.load_setup(Path(__file__).with_name("setup.toml"))
text = Path(__file__).with_name("setup.toml").read_text().replace("[2e-3, 1e-4]", "[1e-2, 5e-4]")
Path("nominal.toml").write_text(
    text
    + """
[joints]
process_noise_density = 50.0    # rad/s^2.5
position_noise_std = 2e-4       # rad
velocity_noise_std = 8e-3       # rad/s

[data_noise]
linear_acceleration = 0.3       # m/s^2
angular_acceleration = 2.0      # rad/s^2
"""
)
setup = ft.load_setup("nominal.toml")
logs = [ft.simulate(truth, duration=seconds, rate=100, seed=seed).log for seed, seconds in enumerate((4, 5, 4, 3))]
samples = [ft.samples_from_log(log) for log in logs]
longest = max(len(log.t) for log in logs)
together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(pad(one, longest) for one in samples))

params = ft.params_for_log(setup, logs[0])
free = {name: ft.unconstrain(params)[name] for name in TRAINED}


@jax.jit
def loss(free):
    """Negative log-likelihood in nats per sample, over all logs; padding does not contribute."""
    values = jax.vmap(ft.log_likelihood, (None, 0))(ft.constrain(params, free), together)
    return -values.sum() / sum(len(log.t) for log in logs)


optimiser = optax.adam(0.1)
step = jax.jit(jax.value_and_grad(loss))
state, before = optimiser.init(free), loss(free)
for i in range(150):
    value, slopes = step(free)
    if i % 30 == 0:
        print(f"step {i:3d}: {value:.3f}")
    changes, state = optimiser.update(slopes, state)
    free = optax.apply_updates(free, changes)

ft.setup_with(setup, ft.constrain(params, free)).save("trained.toml")

# The saved file alone reproduces the likelihood with which the loop ended.
trained = ft.load_setup("trained.toml")
after = loss(ft.unconstrain(ft.params_for_log(trained, logs[0])))
print(f"nats lacking per sample: {before:.3f} as stated, {loss(free):.3f} trained, {after:.3f} as saved")
print("eta of the positions [rad]:", trained.joints.position_noise_std, "truth:", truth.joints.position_noise_std)
assert abs(after - loss(free)) < 1e-6
assert after < before - 1
assert all(abs(trained.joints.position_noise_std / truth.joints.position_noise_std - 1) < 0.2)
