"""One archive on every engine: processes, Dask, Ray and an S3 bucket, also with a worker or the command killed midway.

python experiments/fleet/engines.py [--count 1000] [--engines bucket,dask,ray] [--folder DIR] [--json FILE]
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
from run import PACKAGE, PROGRAM, counted, cpu_seconds, make_log

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.fleet.manifest import contents_of
from ftbias_jax.fleet.place import Place
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.setup import dump_setup, parse_setup

SAMPLES, RATE = 5000, 500.0
MOTIONS = 20  # number of motions that the logs share; bias and noise differ
SAMPLED = 50  # number of logs that one process filters in sequence for comparison
BUCKET = "s3://fleet/"
STORE = {"ACCESS_KEY_ID": "me", "SECRET_ACCESS_KEY": "mine", "DEFAULT_REGION": "us-east-1"}
MANIFEST = "manifest.filter.jsonl"
UNPROFILED = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}  # the profiler takes 7 % of a worker's time
VERSIONS = {name: version(name) for name in ("ftbias-jax", "jax", "numpy", "distributed", "ray", "s3fs", "moto")}
SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER: orphans become children of this process, and so their time is counted


def write_logs(folder, count):
    """Write logs of 10 s at 500 Hz; those of one motion differ in bias and noise."""
    rng, setup = np.random.default_rng(0), parse_setup(SETUP)
    (folder / "setup.toml").write_text(dump_setup(setup))
    for inner in ("logs", "few"):
        (folder / inner).mkdir()
    (folder / "few" / "setup.toml").symlink_to("../setup.toml")
    motions = [make_log(setup, np.zeros(6), 1.7676e9, (3, i), SAMPLES, RATE) for i in range(MOTIONS)]
    for number in range(count):
        log = motions[number % MOTIONS]
        noise = setup.sensor.noise_std * rng.normal(size=log["wrench"].shape)
        bias = np.array([2.0, 2.0, 2.0, 0.1, 0.1, 0.1]) * rng.normal(size=6)
        np.savez(folder / "logs" / f"{number:05d}.npz", **{**log, "wrench": log["wrench"] - bias + noise})


def started(words, **more):
    """Start a process without output; ``ended`` waits for it and its orphans."""
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE), **more}
    return subprocess.Popen(
        [sys.executable, *words], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def ended(process):
    """Wait until a process and its orphans have ended; return the exit code of the process."""
    code = process.wait()
    with suppress(ChildProcessError):
        while orphan := os.waitpid(-1, os.WNOHANG)[0]:
            assert orphan
    return code


def command(folder, output, *more, logs=("logs",)):
    """Start the command that filters the archive; changes the current folder to that of the logs."""
    os.chdir(folder)
    return started(["-c", PROGRAM, "filter", *logs, "--setup", "setup.toml", "-o", output, *more])


def done(place):
    """Number of logs in the manifest so far."""
    if not place.root.startswith(BUCKET):
        path = Path(place.root, MANIFEST)
        return path.read_bytes().count(b'{"log":{') if path.exists() else 0
    return len(contents_of(place).entries)


def kill_in_the_middle(process, place, count, victim):
    """Send SIGKILL to a victim when half the logs are done; return the number of logs done by then."""
    while (found := done(place)) < count / 2:
        assert process.poll() is None
        time.sleep(1.0)
    os.kill(victim(), signal.SIGKILL)
    return found


def working_for_ray():
    """Wait until a worker of Ray has a task; return its process id."""
    while True:
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            with suppress(OSError):
                if path.read_bytes().startswith(b"ray::_in_float64"):
                    return int(path.parent.name)


def computed(pid):
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def watched(process):
    """Yield a function that returns the processor time of a process and of Ray, which reaps its children itself."""
    seconds, over = {}, threading.Event()

    def look():
        while not over.wait(0.25):
            for path in Path("/proc").glob("[0-9]*/cmdline"):
                with suppress(OSError):
                    pid, words = int(path.parent.name), path.read_bytes()
                    if pid == process.pid or words.startswith(b"ray::") or b"/site-packages/ray/" in words:
                        seconds[pid] = computed(pid)

    thread = threading.Thread(target=look)
    thread.start()
    yield lambda: sum(seconds.values())
    over.set()
    thread.join()


@contextmanager
def dask():
    """Run a scheduler with two workers; yield its address, and a function that adds a worker and returns a victim."""
    file = Path(tempfile.mkstemp()[1])
    file.unlink()
    plain = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = started(["-m", "distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", *plain])
    while not file.exists():
        time.sleep(0.2)
    worker = ["-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *plain]
    workers = [started(worker, **UNPROFILED) for _ in range(2)]

    def victim():
        workers.append(started(worker, **UNPROFILED))  # as the operator of a cluster would
        return workers[0].pid

    yield json.loads(file.read_text())["address"], victim
    for process in (*workers, scheduler):
        process.kill()
        process.wait()
    file.unlink(missing_ok=True)


@contextmanager
def server():
    """Run an S3 server with a bucket; yield a function that returns its processor time."""
    more = {"MOTO_S3_DEFAULT_KEY_BUFFER_SIZE": "4096"}  # keeps objects on disk
    said = tempfile.NamedTemporaryFile("w+")  # noqa: SIM115
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]
    process = subprocess.Popen(words, env={**os.environ, **more}, stdout=subprocess.DEVNULL, stderr=said)
    while "Running on" not in Path(said.name).read_text():
        time.sleep(0.2)
    address = next(line.split()[-1] for line in Path(said.name).read_text().splitlines() if "Running on" in line)
    os.environ.update({f"AWS_{name}": value for name, value in {**STORE, "ENDPOINT_URL": address}.items()})
    import s3fs

    s3fs.S3FileSystem().mkdir("fleet")

    yield lambda: computed(process.pid)
    process.kill()
    process.wait()


def run_engine(name, folder, count, served=lambda: 0.0, logs=("logs",)):
    """Filter the archive on one engine; return its measurements, and the manifest's entries by name of their result."""
    place = Place(f"{BUCKET}{folder.name}/{name}" if name.startswith("bucket") else str(folder / name))
    served_before = served()
    start, before = time.perf_counter(), cpu_seconds()
    told = {}
    with ExitStack() as stack:
        if name.startswith("dask"):
            address, victim = stack.enter_context(dask())
            process = command(folder, place.root, "--executor", f"dask:{address}", logs=logs)
        elif name.startswith("ray"):
            process = command(folder, place.root, "--executor", "ray", logs=logs)
            of_ray = stack.enter_context(watched(process))
            victim = working_for_ray
        else:
            process = command(folder, place.root, "--jobs", "1" if name == "alone" else "2", logs=logs)
            victim = lambda: process.pid  # noqa: E731
        if name.endswith("killed"):
            told["done_when_killed"] = kill_in_the_middle(process, place, count, victim)
            if name.startswith("bucket"):
                ended(process)
                told["published_when_killed"] = done(place)
                process = command(folder, place.root, "--jobs", "2")
        code = ended(process)
        wall = time.perf_counter() - start
        entries = {entry.output: entry for entry in contents_of(place).entries.values()}
        with place.reading([MANIFEST]) as here:
            lines = Path(here, MANIFEST).read_bytes().count(b'{"log":{')
        if name.startswith("bucket"):
            sample = sorted(entries)[:: max(1, count // SAMPLED)]
            with place.reading(sample) as here:
                told["results_whose_sum_is_that_of_the_manifest"] = sum(same_sum(here, entries[x]) for x in sample)
            told["cpu_seconds_of_the_server"] = round(served() - served_before, 1)
    ended(process)  # waits for orphans of the engine
    told |= {
        "exit_code": code,
        "statuses": counted(entry.status for entry in entries.values()),
        "errors": sorted({entry.error for entry in entries.values() if entry.error})[:5],
        "logs_twice_in_the_manifest": lines - len(entries),
        "wall_seconds": round(wall, 1),
        "cpu_seconds": round(of_ray() if name.startswith("ray") else cpu_seconds() - before, 1),
    }
    return told, entries


def same_sum(folder, entry):
    from ftbias_jax.io.write.provenance import sha256_of

    return sha256_of(os.path.join(folder, entry.output)) == entry.sums[entry.output]


def compared(folder, name, entries, expected):
    """Count results that are identical byte for byte to those expected, with the largest difference of the others."""
    both = {x for x in entries.keys() & expected.keys() if entries[x].sums}
    others = [x for x in both if entries[x].sums != expected[x].sums]
    told = {"compared": len(both), "same_bytes": len(both) - len(others)}
    if others and (folder / name).is_dir():
        told["largest_difference"] = max(difference(folder / "alone" / x, folder / name / x) for x in others)
    return told


def difference(one, other):
    """Largest relative difference between the arrays of two results."""
    one, other = load_npz(one), load_npz(other)
    assert one.keys() == other.keys()
    names = [name for name in one if one[name].dtype.kind == "f"]
    return max(float(np.nanmax(np.abs(one[n] - other[n])) / (np.nanmax(np.abs(one[n])) + 1e-300)) for n in names)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--engines", default="jobs,dask,dask-killed,ray,ray-killed,bucket,bucket-killed")
    parser.add_argument("--folder", help="empty or new; kept (default: one that is removed)")
    parser.add_argument("--json", type=Path, default=Path(__file__).with_name("engines.json"), help="result")
    arguments = parser.parse_args()
    ctypes.CDLL(None).prctl(SUBREAPER, 1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.folder or temporary).absolute()
        folder.mkdir(exist_ok=True)
        measure(folder, arguments.count, arguments.engines.split(","), arguments.json.absolute())


def measure(folder, count, engines, output):
    write_logs(folder, count)
    sample = [f"logs/{i:05d}.npz" for i in range(0, count, max(1, count // SAMPLED))]
    ended(command(folder, "warm", logs=sample[:2]))  # fills the compilation cache
    told, alone = run_engine("alone", folder, len(sample), logs=sample)
    result = {"logs": count, "samples": SAMPLES, "alone": {**told, "logs": len(sample)}}
    with ExitStack() as stack:
        served = stack.enter_context(server()) if "bucket" in "".join(engines) else lambda: 0.0
        for name in engines:
            result[name] = one_engine(name, folder, count, served, alone, result.get("jobs"))
            if not name.endswith("killed"):  # a run with few logs measures the cost of the start
                few = run_engine(name, folder / "few", len(sample), served, [f"../{path}" for path in sample])[0]
                further = (result[name]["cpu_seconds"] - few["cpu_seconds"]) / (count - len(sample))
                result[name]["cpu_seconds_of_few"] = few["cpu_seconds"]
                result[name]["cpu_seconds_a_further_log"] = round(further, 4)
            print(name, json.dumps(result[name], indent=1), flush=True)
            text = json.dumps({"versions": VERSIONS, "result": result}, indent=1)
            output.write_text(text + "\n")


def one_engine(name, folder, count, served, alone, jobs):
    """Measure one engine, relative to ``--jobs``, and compare its results with those of one process."""
    told, entries = run_engine(name, folder, count, served)
    assert len(entries) == count
    told["cpu_seconds_a_log"] = round(told["cpu_seconds"] / count, 4)
    told |= compared(folder, name, entries, alone)
    for what in ("wall_seconds", "cpu_seconds") if jobs else ():
        told[f"{what}_by_jobs"] = round(told[what] / jobs[what], 3)
    shutil.rmtree(folder / name, ignore_errors=True)
    return told


if __name__ == "__main__":
    main()
