import os
import subprocess
import sys

import pytest

PRINT = "from ftbias_jax.cli.terminal import *; print_what_the_terminal_can(); import sys; print(sys.argv[1])"


@pytest.mark.parametrize("code", [0x07, 0x08, 0x1B, 0x7F, 0x9B, 0x9D, 0x061C, 0x202E, 0x2028, 0x2066])
def test_what_would_steer_a_terminal_is_printed_as_its_code(code):
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run([sys.executable, "-c", PRINT, f"a{chr(code)}[31m\tb"], capture_output=True, env=environment)
    shown = done.stdout.decode()
    assert chr(code) not in shown
    assert f"{code:02x}[31m\tb" in shown
