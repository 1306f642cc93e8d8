import os
import subprocess
import sys

import pytest

from ftbias_jax.cli.main import main

PRINT = "from ftbias_jax.cli.terminal import *; print_what_the_terminal_can(); import sys; print(sys.argv[1])"


@pytest.mark.parametrize("code", [0x07, 0x08, 0x1B, 0x7F, 0x9B, 0x9D, 0x061C, 0x202E, 0x2028, 0x2066])
def test_what_would_steer_a_terminal_is_printed_as_its_code(code):
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run([sys.executable, "-c", PRINT, f"a{chr(code)}[31m\tb"], capture_output=True, env=environment)
    shown = done.stdout.decode()
    assert chr(code) not in shown
    assert f"{code:02x}[31m\tb" in shown


def test_a_reader_that_has_gone_is_no_traceback():
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "ftbias_jax.cli.main", "--print-completion", "bash"]
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, b"")


@pytest.mark.parametrize("output", [".", "..", "/"])
def test_a_folder_is_no_name_of_a_setup(output, capsys):
    assert main(["setup", "--robot", "panda", "-o", output]) == 2
    assert "end the name in .toml" in capsys.readouterr().err
