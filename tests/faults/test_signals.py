"""Ctrl-C and SIGTERM: exit code 1 at once, no children and no temporary files left, no half result under its name."""

import io
import os
import signal
import subprocess
import sys
import time

import pytest

import ftbias_jax
from ftbias_jax.cli.terminal import print_what_the_terminal_can

START = """
import signal, sys, time
from ftbias_jax.runtime.signals import end_on_signals
if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # Whoever started the tests may ignore them: nohup, a shell with its jobs in the background, some CI.
        signal.signal(number, signal.SIG_IGN if number.name in sys.argv[1:] else signal.SIG_DFL)
    end_on_signals("interrupted\\n")
"""
WRITING = """
    from ftbias_jax.io.atomic import write_atomic
    def write(file):
        file.write(b"half")
        print("ready", flush=True)
        time.sleep(60)
    write_atomic("result.npz", write)
"""
SAVING = """
    import os
    from ftbias_jax.files import temporary_folder
    with temporary_folder() as folder:
        open(folder + "/unpacked", "w").close()
        print(folder, flush=True)
        time.sleep(60)
"""
SWALLOWING = """
    print("ready", flush=True)
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass
"""


@pytest.fixture
def start():
    """Start a program in a folder, ignoring the given signals; kill it at the end if it still runs."""
    running = []

    def begin(folder, program, *ignored):
        running.append(process := launch(folder, program, ignored))
        return process

    yield begin
    for process in running:
        process.kill()
        process.communicate()


def launch(folder, program, ignored):
    (folder / "program.py").write_text(START + program)
    environment = {**os.environ, "PYTHONPATH": os.path.dirname(os.path.dirname(ftbias_jax.__file__))}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen([sys.executable, "program.py", *ignored], cwd=folder, env=environment, **streams)


every_signal = pytest.mark.parametrize("numbers", [[signal.SIGINT], [signal.SIGINT] * 3, [signal.SIGTERM]])


@every_signal
def test_a_signal_ends_a_process_that_writes_and_leaves_nothing(start, tmp_path, numbers):
    process = start(tmp_path, WRITING)
    assert process.stdout.readline() == "ready\n"
    assert len(list(tmp_path.iterdir())) == 2  # the program, and an unfinished output
    for number in numbers:
        process.send_signal(number)
    printed, _ = process.communicate(timeout=20)
    assert process.returncode == 1
    assert printed == "interrupted\n"
    assert os.listdir(tmp_path) == ["program.py"]


def test_a_signal_removes_what_was_unpacked_elsewhere(start, tmp_path):
    process = start(tmp_path, SAVING)
    folder = process.stdout.readline().strip()
    assert os.path.isdir(folder)
    process.terminate()
    process.communicate(timeout=20)
    assert process.returncode == 1
    assert not os.path.exists(folder)


def test_an_interrupt_where_exceptions_are_swallowed_ends_all_the_same(start, tmp_path):
    process = start(tmp_path, SWALLOWING)
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == 1


def test_a_signal_that_was_ignored_stays_ignored(start, tmp_path):
    process = start(tmp_path, WRITING, "SIGINT", "SIGHUP")
    assert process.stdout.readline() == "ready\n"
    for number in (signal.SIGINT, signal.SIGHUP):
        process.send_signal(number)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.5)
    process.terminate()
    assert process.communicate(timeout=20)[0] == "interrupted\n"


SLEEPING = """
import os, time
def sleep(task):
    open(f"child-{os.getpid()}", "w").close()
    time.sleep(100)
"""


@every_signal
def test_a_signal_ends_the_processes_of_jobs(start, tmp_path, numbers):
    (tmp_path / "sleeping.py").write_text(SLEEPING)
    program = """
    from ftbias_jax.runtime.executors import run_each
    from sleeping import sleep
    for _ in run_each(sleep, range(4), 2):
        print("a task ended")
"""
    process = start(tmp_path, program)
    deadline = time.monotonic() + 60
    while len(children := list(tmp_path.glob("child-*"))) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    for number in numbers:
        process.send_signal(number)
    printed, _ = process.communicate(timeout=20)  # ends only when no child holds the pipe, either
    assert process.returncode == 1
    assert printed == "interrupted\n"  # no traceback, no finished task, no leaked semaphore
    for child in children:
        assert not os.path.exists(f"/proc/{child.name.removeprefix('child-')}/exe")


@pytest.mark.parametrize(("encoding", "shown"), [("ascii", "0.8 +- 0.1 kg, ?\n"), ("utf-8", "0.8 ± 0.1 kg, 工\n")])
def test_tables_are_printed_whatever_the_terminal_knows(monkeypatch, encoding, shown):
    printed = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(printed, encoding))
    print_what_the_terminal_can()
    print("0.8 ± 0.1 kg, 工", flush=True)
    assert printed.getvalue().decode(encoding) == shown
