"""The commands about a simulator of the user's own."""

from ftbias_jax.cli.options import FORCE, LOGS, OUTSIDE, SEED, Command, count, option, output, setup

OF_SIMULATORS = {
    "replay": Command(
        "write what a scene of MuJoCo says the sensor feels in a recorded motion",
        "Replay LOG in the scene of the setup, or in another, by inverse dynamics at the recorded states, and write "
        "the wrench at the sensor's site, for ftbias diagnose LOG --against SIM.npz.",
        (
            option("logs", "LOG", "a log of the same robot", nargs=1),
            setup("with the scene: [robot] mjcf"),
            option("--mjcf", "SCENE.xml", "another scene with the same arm", default=""),
            output("SIM.npz", "where to write it", required=True),
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias replay monday.npz --setup setup.toml -o sim.npz",
        "simulators.replay",
    ),
    "sample": Command(
        "draw many simulators that the data allow, to train on",
        "Draw from the joint posterior of what DIAGNOSIS found, within the bounds of its effects: for each draw a "
        "scene and the errors of its sensor, and in ranges.json means, covariance and ranges.",
        (
            option("found", "DIAGNOSIS.json", "what ftbias diagnose --json wrote"),
            setup("of the diagnosis"),
            option("--like", "SCENE.xml", "the scene to mend for each draw (default: sensor models alone)", default=""),
            option("--count", "N", "how many (%(default)s)", type=count, default=100),
            output("FOLDER", "where to write them", required=True),
            SEED,
            FORCE,
        ),
        "Example: ftbias sample found.json --setup setup.toml --like scene.xml -o samples",
        "simulators.sample",
    ),
    "validate-sim": Command(
        "see on other logs how far a mended scene is from them, and was before",
        "Replay LOGs, best others than those of the diagnosis, in the scene as it was and as it was mended, with the "
        "sensor's errors that were found, and compare both with the recordings, channel by channel.",
        (
            LOGS,
            setup("of the scene as it was"),
            option("--found", "DIAGNOSIS.json", "what was found, or the setup with it (.toml)", required=True),
            option("--like", "SCENE.xml", "the scene as it was (default: the setup's)", default=""),
            option("--mended", "MENDED.xml", "the mended scene", required=True),
            option("--json", "OUT.json", "also write the comparison for programs"),
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias validate-sim tuesday.npz --setup setup.toml --found found.json --mended mended.xml",
        "simulators.replay:validate",
    ),
}
