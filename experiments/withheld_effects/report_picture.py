#!/usr/bin/env python3
"""Draw the README's picture of the demonstration's report by headless Chromium. python report_picture.py"""

import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

from ftbias_jax.cli.main import main

OUT = Path(__file__).parents[2] / "docs" / "pages" / "assets" / "report.png"
SIZE = 1000, 1280  # px; ends after the plots against time
COLORS = 64

if __name__ == "__main__":
    browser = shutil.which("chromium") or shutil.which("google-chrome") or "chromium"
    with tempfile.TemporaryDirectory() as folder:
        if main(["demo", "-o", folder]):
            raise SystemExit("the demonstration failed")
        picture = Path(folder) / "picture.png"
        options = ["--headless", "--no-sandbox", "--hide-scrollbars", f"--window-size={SIZE[0]},{SIZE[1]}"]
        page = Path(folder) / "report.html"
        subprocess.run([browser, *options, f"--screenshot={picture}", page.as_uri()], check=True, capture_output=True)
        Image.open(picture).convert("RGB").quantize(COLORS).save(OUT, optimize=True)
