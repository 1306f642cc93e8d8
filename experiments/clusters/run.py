"""Run the Slurm recipe of the docs on a one-machine Slurm cluster, and validate the Kubernetes manifest.

    apt-get install slurm-wlm munge; pip install kubernetes-validate
    python run.py                      # into result.json

The array of two jobs filters twelve logs, one of them damaged. As soon as a result is there, both jobs are requeued, as
preemption does. Slurm's daemons need root; each runs in a folder of its own and is stopped at the end.
"""

import argparse
import getpass
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
DEPLOY = HERE.parents[1] / "docs" / "deploy"
SHARDS, LOGS, SAMPLES = 2, 12, 30_000
PATIENCE = 600  # s

SLURM = """\
ClusterName=one
SlurmctldHost={host}
SlurmctldPort=17817
SlurmdPort=17818
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
SlurmUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
KillWait=10
NodeName={host} CPUs=2 RealMemory=2000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def call(*command, **options):
    """Run a command and return its output; a failure raises RuntimeError."""
    done = subprocess.run(command, capture_output=True, text=True, **options)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr or done.stdout}")
    return done.stdout


@contextmanager
def slurm(folder):
    """Run a Slurm cluster of one node with two cores on this machine."""
    host = os.uname().nodename
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    configuration = folder / "slurm.conf"
    configuration.write_text(SLURM.format(host=host, folder=folder, user=getpass.getuser()))
    os.environ["SLURM_CONF"] = str(configuration)
    paths = {"socket": "munge.socket", "key-file": "munge.key", "pid-file": "munge.pid", "seed-file": "munge.seed"}
    options = [f"--{option}={folder / name}" for option, name in (*paths.items(), ("log-file", "munge.log"))]
    daemons = [
        ["munged", "--foreground", "--force", *options],
        ["slurmctld", "-D", "-i"],
        ["slurmd", "-D", "-N", host],
    ]
    running = []
    try:
        for daemon in daemons:
            running.append(subprocess.Popen(daemon, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            time.sleep(2)
        wait_for(lambda: "idle" in call("sinfo", "--noheader", "--format=%T"), 60)
        yield
    finally:
        for process in reversed(running):
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(20)
            process.kill()


def wait_for(condition, patience=PATIENCE):
    """Wait until a condition holds.

    Raises:
        TimeoutError: the condition did not hold within ``patience`` s.
    """
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("nothing happens: see the daemons' logs")
        time.sleep(0.5)


def make_logs(folder):
    """Write logs of the demonstration's arm, one of them truncated."""
    ftbias("demo", "-o", "demo", "--duration", str(SAMPLES / 500), "--rate", "500", cwd=folder)
    (folder / "runs").mkdir()
    whole = next((folder / "demo").glob("*.npz"))
    with np.load(whole, allow_pickle=False) as log:
        arrays = dict(log)
    rng = np.random.default_rng(0)
    for number in range(LOGS):
        shifted = arrays | {"wrench": arrays["wrench"] + rng.normal(size=6) * [1, 1, 1, 0.05, 0.05, 0.05]}
        np.savez(folder / "runs" / f"log_{number:02d}.npz", **shifted)
    damaged = folder / "runs" / "log_05.npz"
    damaged.write_bytes(damaged.read_bytes()[:5000])


def ftbias(*arguments, cwd):
    """Run an ``ftbias`` command in folder ``cwd``."""
    program = "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"
    return subprocess.run([sys.executable, "-c", program, *arguments], cwd=cwd, capture_output=True, text=True)


def states():
    """Index of an array job -> (state, number of restarts, exit code)."""
    found = {}
    for job in json_of_jobs():
        if "ArrayTaskId" in job and job["ArrayTaskId"].isdigit():
            found[int(job["ArrayTaskId"])] = (job["JobState"], int(job["Restarts"]), job["ExitCode"])
    return found


def json_of_jobs():
    """Return the fields of every job that Slurm knows."""
    lines = call("scontrol", "--oneliner", "show", "jobs").splitlines()
    return [dict(field.split("=", 1) for field in line.split() if "=" in field) for line in lines]


def run_slurm(folder):
    """Run the recipe on twelve logs, with both jobs requeued in the middle."""
    make_logs(folder)
    command = shutil.which("ftbias") or sys.exit("ftbias is not on the PATH: pip install -e .")
    results = folder / "results"
    with slurm(folder):
        environment = {**os.environ, "PATH": f"{Path(command).parent}:{os.environ['PATH']}"}
        recipe = str(DEPLOY / "slurm_filter.sh")
        submitted = ["sbatch", f"--array=1-{SHARDS}", "--cpus-per-task=1", "--mem-per-cpu=900M", recipe]
        number = call(*submitted, "runs", "demo/setup.toml", "results", cwd=folder, env=environment).split()[-1]
        wait_for(lambda: any(results.rglob("*.npz")))
        done_before = {path.name: path.stat().st_mtime_ns for path in results.rglob("*.npz")}
        call("scontrol", "requeue", f"{number}_1")
        call("scontrol", "requeue", f"{number}_2")
        wait_for(lambda: states() and all(state == "COMPLETED" for state, _, _ in states().values()))
        jobs = states()
    made = {path.name: path.stat().st_mtime_ns for path in results.rglob("*.npz")}
    output = "".join(path.read_text() for path in folder.glob("slurm-*.out"))
    return {
        "slurm": call("slurmctld", "-V").strip(),
        "logs": LOGS,
        "results": len(made),
        "damaged": LOGS - len(made),
        "jobs": {str(task): {"state": s, "restarts": r, "exit_code": c} for task, (s, r, c) in sorted(jobs.items())},
        "results_before_requeue": len(done_before),
        "done_twice": sum(made.get(name) != stamp for name, stamp in done_before.items()),
        "told_data_loss": "finished with data loss" in output,
    }


def validate_kubernetes():
    """Validate every resource of the manifest against the official schemas; None if no validator is installed."""
    validator = shutil.which("kubernetes-validate")
    if validator is None:
        return None
    checked = subprocess.run([validator, "--strict", str(DEPLOY / "kubernetes.yaml")], capture_output=True, text=True)
    lines = (checked.stdout + checked.stderr).splitlines()
    resources = [line.split("resource ")[1] for line in lines if "passed for resource" in line]
    return {"exit_code": checked.returncode, "passed": resources}


def main():
    from common import keep

    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as name:
        result = {"slurm": run_slurm(Path(name)), "kubernetes": validate_kubernetes()}
    print(json.dumps(result, indent=1))
    keep(__file__, result)


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    main()
