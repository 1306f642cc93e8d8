"""The commands that filter, judge, explain and show logs."""

from ftbias_jax.cli.options import (
    ARCHIVE,
    FOLDER,
    FORCE,
    LOGS,
    OUTSIDE,
    OWN_EFFECTS,
    SEED,
    UNCHECKED,
    Command,
    choice,
    count,
    either,
    fields,
    flag,
    gate,
    group,
    length,
    option,
    output,
    positive,
    setup,
    share,
)

OF_LOGS = {
    "filter": Command(
        "estimate bias and drift of logs and correct their wrench",
        "Estimate bias and drift at every wrench sample of LOG, and write them with the corrected wrench. Where OUT is "
        "a folder, all logs are filtered into it, and those that it has already are skipped.",
        (
            option(
                "logs",
                "LOG",
                "log: .npz .csv .parquet .h5 .bag .db3 .mcap or a ROS 2 bag's folder; for a folder OUT also many "
                "logs, folders to search, or patterns in quotes",
                nargs="+",
            ),
            setup(),
            output("OUT", "the result: .npz .csv .parquet or .mcap, or a folder", required=True),
            flag("--salvage", "read what is whole of a damaged recording"),
            flag("--smooth", "also write the bias given past and future"),
            flag("--check", "also judge whether the filter's error bars are right"),
            option("--plot", "OUT.png", "also draw bias and residual (needs the extra 'plot')"),
            option("--offsets", "OUT.yaml", "also write the bias at the end as offsets that ros2_control adds"),
            option(
                "--gate",
                "SIGMAS",
                "do not use wrenches farther than this off their prediction: contacts and spikes (6)",
                type=gate,
            ),
            flag(
                "--as-stated",
                "filter as on the robot: joints from the past alone, noise as the setup states, contact not looked for",
            ),
            UNCHECKED,
            OWN_EFFECTS,
            group(
                "what is written",
                option(
                    "--fields",
                    "NAME[,NAME...]",
                    "arrays to write beside t: bias,bias_std,wrench_unbiased,... as in the reference of results (all)",
                    type=fields,
                    default=(),
                ),
                choice("--precision", "single double", "of the numbers; t is double in any case (%(default)s)"),
                either(
                    option("--every", "N", "write every N-th sample (%(default)s)", type=count, default=1),
                    option("--output-rate", "HZ", "write at most so many samples a second (all)", type=positive),
                ),
                description="Samples are left out, never averaged: the values are those of the samples that are kept. "
                "Bias and error bars lose nothing; in the corrected wrench, vibration above half the output's rate "
                "folds to lower frequencies.",
            ),
            group(
                "for a folder",
                *FOLDER,
                choice("--format", "npz csv parquet mcap", "of the results (%(default)s)"),
            ),
            OUTSIDE,
            FORCE,
        ),
    ),
    "check": Command(
        "see from logs whether a setup can be right: signs, units, frames",
        "Say which mistakes of sign, unit, frame or convention LOGs show in a setup, and what to write instead. Exits "
        "with 1 if there are any. The other commands look for the same first.",
        (
            LOGS,
            setup(),
            option("--json", "OUT.json", "also write the findings for programs"),
            output("FOLDER", "check each log by itself, into this folder"),
            ARCHIVE,
            OUTSIDE,
            FORCE,
        ),
    ),
    "diagnose": Command(
        "find where logs depart from the model, why, and how far the gap shrinks",
        "Find which effects that the setup does not know cause the gap between LOGs and model.",
        (
            LOGS,
            setup(),
            option("--json", "OUT.json", "also write the diagnosis for programs"),
            option("--html", "OUT.html", "also write a report with plots, one file"),
            flag("--apply", "also write a setup that has the causes as effects"),
            output(
                "OUT",
                "where to write that setup; or a folder: diagnose each log alone into it, with --apply a setup for "
                "each",
            ),
            flag("--in-place", "let --apply replace SETUP.toml"),
            option("--without", "EFFECT", "leave this effect out; may be repeated", action="append", default=[]),
            option(
                "--against",
                "SIM.npz",
                "the gap of your own simulator: its wrench for each LOG, as ftbias replay writes it",
                nargs="+",
                default=[],
            ),
            option(
                "--pool",
                "by=robot",
                "LOGs of one robot over time: diagnose the latest ones together, and say when each cause began and how "
                "it went on; ftbias report shows what --json writes as *.pooled.json",
                choices=("by=robot",),
            ),
            UNCHECKED,
            OWN_EFFECTS,
            ARCHIVE,
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias diagnose LOG.npz --setup SETUP.toml --html REPORT.html --apply -o FIXED.toml",
    ),
    "plan": Command(
        "plan the motion that tells most about the tool, an effect, or which of two it is",
        "Find a motion within the limits of the robot and of [limits] that tells most about what is asked, and say how "
        "well it will tell. It knows nothing of self-collision, and nothing of what stands in the cell.",
        (
            setup("robot, sensor, tool, noise, effects and limits"),
            option(
                "--for",
                "tool|noise|EFFECT|A:B",
                "tell the parameters of the tool, of the noise or of an effect, or one effect from another (default: "
                "the two that --diagnosis cannot distinguish, or the tool)",
                dest="to_find",
                default="",
            ),
            option("--diagnosis", "OUT.json", "what ftbias diagnose found: effects as large as there", default=""),
            option(
                "--from", "LOG", "logs at hand, whose first pose the plan starts in", dest="logs", nargs="+", default=[]
            ),
            option("--start", "Q", "first and last pose instead: rad for every joint", type=float, nargs="+"),
            *length(20.0, 500.0),
            option("--margin", "SHARE", "of every limit, left unused (%(default)s)", type=share, default=0.1),
            output("MOTION.csv", "where to write the motion, .csv, .npz or .parquet", required=True),
            option("--json", "PLAN.json", "also write what it will tell, for programs"),
            option("--html", "PLAN.html", "also write a page: paths, limits, standard errors"),
            group(
                "for controllers",
                option("--ros", "FILE.yaml", "also write a JointTrajectory of ROS 2"),
                option("--bag", "FILE.mcap", "also write it as a recording, for ros2 bag play"),
                option("--ur", "FILE.script", "also write a URScript that follows it by servoj"),
                option("--franka", "FILE.json", "also write joint positions and velocities for every millisecond"),
            ),
            SEED,
            OWN_EFFECTS,
            OUTSIDE,
            FORCE,
        ),
        "Example: ftbias plan --setup SETUP.toml --for tool --duration 20 -o motion.csv --json plan.json",
        "simulate:plan_motion",
    ),
    "effects": Command(
        "list and describe the effects that are looked for, or check your own",
        "List all effects; describe those named; or find faults in a Python file with your own.",
        (
            option("words", "NAME", "effects to describe; or: check FILE.py", nargs="*"),
            OWN_EFFECTS,
        ),
        "Examples: ftbias effects; ftbias effects cable; ftbias effects check my_effects.py",
    ),
    "info": Command(
        "show what is in a log and what can be filtered from it",
        "Show streams, rates, gaps, stuck or saturated axes and joint names of LOG.",
        (
            option("log", "LOG", "any log: .npz .csv .parquet .h5 .bag .db3 .mcap or a bag's folder"),
            option("--setup", "SETUP.toml", "also tell whether LOG can be filtered with it"),
            OUTSIDE,
        ),
    ),
    "report": Command(
        "show what the logs of a fleet show together, or one result, as a page",
        "Read the manifests in FOLDERs, and write which logs have a gap and why, bias and residual over time by robot "
        "and sensor, and alarms: a bias that ages, a cause that appears. Of one RESULT.npz of ftbias filter, write its "
        "bias over time.",
        (
            option("folders", "FOLDER", "results of filter, check and diagnose; or one RESULT.npz", nargs="+"),
            output("PAGE.html", "where to write the page", required=True),
            FORCE,
        ),
        "Example: ftbias report results -o fleet.html",
    ),
    "compare": Command(
        "show what differs between two setups, results, diagnoses or checks",
        "Show the keys of two setups, the arrays of two results, or the values of two JSON files that differ. The exit "
        "code is 1 if anything does.",
        (
            option("one", "ONE", "a setup (.toml), a result (.npz), a diagnosis or a check (.json)"),
            option("two", "TWO", "another of the same kind"),
        ),
    ),
}
