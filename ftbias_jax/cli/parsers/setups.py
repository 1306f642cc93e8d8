"""The commands whose result is a setup, or a simulated log."""

from ftbias_jax.cli.options import (
    ARCHIVE,
    FORCE,
    HOLD_OUT,
    IN_PLACE,
    LOGS,
    LOGS_OF_ONE,
    OUTSIDE,
    OWN_EFFECTS,
    SEED,
    UNCHECKED,
    Command,
    choice,
    flag,
    length,
    option,
    output,
    positive,
    process,
    restarts,
    setup,
)
from ftbias_jax.setup.robots import CONVENTIONS, UNITS

OF_SETUPS = {
    "setup": Command(
        "draft a setup from a robot's name, a URDF, an MJCF or a log",
        "Write a commented setup with everything that the robot's name, its URDF or MJCF and LOG tell: kinematics, "
        "limits, names of joints, topics, mounting, noise, and the tool by its weight. What is left says 'measure me'.",
        (
            option("logs", "LOG", "a log that shall be filtered with it; or all its files, one a stream", nargs="*"),
            option("--robot", "NAME", "a built-in robot; --list shows them", default=""),
            option("--urdf", "FILE", "a URDF instead", default=""),
            option("--mjcf", "FILE", "an MJCF instead (needs the extra 'mujoco')", default=""),
            option("--site", "SITE", "of the MJCF: where the sensor is (default: as its sensors say)", default=""),
            option("--base", "LINK", "base: link of the URDF (the root), or body of the MJCF (the world)", default=""),
            option("--tip", "LINK", "flange of the URDF (default: tool0, flange, ...)", default=""),
            option("--dh", "FILE", "a Denavit-Hartenberg table instead: CSV, columns a, alpha, d, theta", default=""),
            option(
                "--dh-convention",
                None,
                "of the table; modified is Craig's (default: none)",
                default="",
                choices=CONVENTIONS,
            ),
            option(
                "--dh-units",
                None,
                "of the table (default: as its header states, as in 'a [mm]')",
                default="",
                choices=UNITS,
            ),
            option("--mass", "KG", "of all that is distal of the sensor, if known", type=positive),
            option("--center-of-mass", ("X", "Y", "Z"), "of the same, m, sensor frame", type=float, nargs=3),
            option("--rate", "HZ", "of a log without stamps", type=positive),
            output("SETUP.toml", "the file to write (default: standard output)"),
            flag("--schema", "print the JSON Schema of setups, for editors"),
            flag("--list", "print the built-in robots"),
        ),
        "Example: ftbias setup pick.bag --robot ur10e -o setup.toml",
    ),
    "tune": Command(
        "fit the noise parameters to logs by maximum likelihood",
        "Fit the noise of joints, bias and sensor to LOGs of one robot, and write a setup with the result.",
        (
            option("logs", "LOG", LOGS_OF_ONE, nargs="*"),
            option(
                "--setup",
                ("SETUP.toml", "LOG"),
                "robot, sensor, tool and noise to start from; with --fit data one --setup for each of several tools, "
                "each followed by its logs",
                required=True,
                nargs="+",
                action="append",
            ),
            output(
                "OUT",
                "where to write the tuned setup, one -o for each --setup, in their order; or a folder: tune to each "
                "log by itself into it",
                action="append",
            ),
            IN_PLACE,
            option(
                "--fit",
                None,
                "what to fit: joint noise, sigma_Q, sensor noise (these three), and Sigma_D, noise of the motion at "
                "the sensor",
                nargs="+",
                default=["joints", "bias", "sensor"],
                choices=["joints", "bias", "sensor", "data"],
            ),
            choice(
                "--data-noise",
                "one three entries",
                "Sigma_D: one number each for linear acceleration, angular acceleration, rate and gravity, three for "
                "the axes of the sensor, or all entries of D (%(default)s)",
            ),
            choice(
                "--tie",
                "each pair one",
                "sigma_Q and sensor noise: one value for each axis, for forces and torques, or for all (%(default)s)",
            ),
            option(
                "--restarts",
                "N",
                "further starts, all values off by random factors, to see whether they agree (%(default)s)",
                type=restarts,
                default=1,
            ),
            HOLD_OUT,
            flag("--force", "write the result even if it predicts unseen data worse than the setup"),
            option(
                "--distributed",
                "HOST:PORT,N,I",
                "one of N processes, the I-th from 0, that share the logs; nothing to give under Slurm or MPI",
                type=process,
                nargs="?",
                const=(None, None, None),
            ),
            UNCHECKED,
            OWN_EFFECTS,
            ARCHIVE,
            OUTSIDE,
        ),
    ),
    "identify": Command(
        "find the tool's mass, centre of mass and inertia from a log",
        "Fit the tool's inertial parameters, physically consistent, jointly with the bias.",
        (
            option(
                "logs",
                "LOG",
                "log of free motion that turns the wrist, or a table of 4 to 1000 static poses, with or without "
                "time; for a folder OUT also many of them, folders to search, or patterns in quotes",
                nargs="+",
            ),
            setup("robot, sensor, and a tool to start from"),
            output("OUT", "where to write the setup found; or a folder for each log's"),
            IN_PLACE,
            flag("--mounting", "also find how the sensor is turned on the flange"),
            flag("--gravity", "also find the direction of gravity"),
            flag("--bias", "also write the bias of LOG with its standard error, as the prior of logs recorded next"),
            flag(
                "--crosstalk",
                "also find the gains of the sensor's channels and the leaks between them, if LOG shows them",
            ),
            flag("--payloads", "first find when a part is gripped and let go in LOG, its mass and its place"),
            UNCHECKED,
            ARCHIVE,
            OUTSIDE,
            FORCE,
        ),
    ),
    "calibrate": Command(
        "from logs to a setup: draft, diagnose, identify, and keep what predicts unseen data better",
        "Draft or take a setup, find causes of the gap and the tool, and keep each step only if the setup with it "
        "predicts the end of LOGs, which it has not seen, better than without.",
        (
            LOGS,
            option("--setup", "SETUP.toml", "where to start (default: a draft from the first log)"),
            option("--robot", "NAME", "of the draft: a built-in robot", default=""),
            option("--urdf", "FILE", "of the draft: a URDF instead", default=""),
            output("OUT.toml", "where to write the setup", required=True),
            option("--html", "OUT.html", "also write a page: steps, errors, and the setup"),
            option("--json", "OUT.json", "also write steps and errors for programs"),
            flag("--bias", "also write the bias at the end of the longest log, as the prior of logs recorded next"),
            HOLD_OUT,
            UNCHECKED,
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias calibrate monday.bag --robot ur10e -o setup.toml --html calibration.html",
    ),
    "export": Command(
        "write the tool for UR, Franka or ROS, what was found into a simulator's file, or a layout for viewers",
        "Write the tool of SETUP.toml (and for ROS its bias) as a robot's controller or a package of ROS reads it, in "
        "the frame and sign that it needs; what DIAGNOSIS.json found, or the effects of SETUP.toml, into a simulator's "
        "own file, with sensor_model.toml and not_expressed.json beside it; or a layout of the topics that filter "
        "writes as MCAP.",
        (
            option(
                "found",
                "SETUP.toml",
                "with the tool; or DIAGNOSIS.json for mjcf, urdf and sensor; layouts do without",
                nargs="?",
                default="",
            ),
            option(
                "--format",
                None,
                "ur: URScript; franka: setLoad as JSON; ros: ros2_control's broadcaster with gravity compensation, "
                "YAML; ft_calib: YAML of force_torque_tools; mjcf: a scene of MuJoCo; urdf: a robot; sensor: the "
                "sensor's own errors, for any simulator; foxglove, plotjuggler: layouts",
                required=True,
                choices=["ur", "franka", "ros", "ft_calib", "mjcf", "urdf", "sensor", "foxglove", "plotjuggler"],
            ),
            option("--setup", "SETUP.toml", "the setup of DIAGNOSIS.json", default=""),
            option(
                "--like", "SCENE.xml", "mjcf, urdf: the file to mend, whose comments and layout are kept", default=""
            ),
            option(
                "--site",
                "SITE",
                "mjcf: where the sensor is in the scene (as the setup or its sensors say); urdf: the link that is the "
                "tool (tool.from_urdf_link of the setup)",
                default="",
            ),
            option("--base", "BODY", "mjcf: whose frame is the setup's base frame (as the setup says)", default=""),
            output("FILE", "the file to write (default: standard output)"),
            option(
                "--sensor-mass",
                ("KG", "X", "Y", "Z"),
                "ur, franka: what is between flange and sensor, as the sensor's body: mass, and centre in m, flange "
                "frame",
                type=float,
                nargs=4,
            ),
            flag(
                "--frames-as-stated",
                "ur, franka: the flange of a setup with a URDF or a list of joints is the controller's tool flange, "
                "and a mounting of the sensor that is not stated is zero",
            ),
            option("--sensor-frame", "FRAME", "ros, ft_calib: the sensor's frame (%(default)s)", default="ft_sensor"),
            option("--world-frame", "FRAME", "ros: name of the base frame (the one of the robot's maker)", default=""),
            FORCE,
        ),
        "Examples: ftbias export identified.toml --format ur -o payload.script; ftbias export found.json "
        "--setup setup.toml --format mjcf --like scene.xml -o mended.xml",
        "simulators.export",
    ),
    "simulate": Command(
        "make a log with known truth, with any effects",
        "Simulate a log of the setup's robot, sensor and tool, and write what is true to another file.",
        (
            setup("robot, sensor, tool, noise and effects"),
            output("LOG.npz", "where to write the log", required=True),
            option("--truth", "FILE", ".npz or .json with the truth (default: LOG_truth.npz)"),
            option(
                "--effect",
                "NAME[:key=value,...]",
                "what the setup does not know; vectors as 1/2/3; typical values if none are given; may be repeated",
                action="append",
                default=[],
            ),
            *length(60.0, 500.0),
            option("--motion", "sines|moves|FILE", "motion, or a log to replay (%(default)s)", default="sines"),
            SEED,
            OWN_EFFECTS,
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias simulate --setup SETUP.toml --effect tool_mass:mass=0.8 --effect time_delay -o LOG.npz",
    ),
    "demo": Command(
        "simulate a Panda that is not as its setup says, filter, diagnose and mend it; needs no files",
        "Simulate a Panda log with an effect its setup does not know, filter it, find the effect, put it into the "
        "setup, filter again, and compare with the truth.",
        (output("DIR", "folder to write (%(default)s)", default="ftbias_demo"), *length(30.0, 250.0), SEED),
    ),
}
