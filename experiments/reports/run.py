"""Diagnosis reports of all kinds: headlines, and layout in headless Chromium at the widths of a desktop and a phone.

The cases are every effect of the catalogue, pairs, several logs, poses, no effect and gaps that match no effect. Counts
the words of each headline, text that is cut off, pages wider than the screen, and violations that axe finds.
Needs Chromium, its driver, and the Python packages selenium and axe-core-python; without them only the headlines are
read. ``run.py FOLDER`` keeps the pages there.
"""

import re
import shutil
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from common import PARAMS, SETUP, keep

import ftbias_jax as ft
from ftbias_jax.model.kinematics.recorded_pose import motions_of, path_of
from ftbias_jax.setup import parse_setup

DURATION, RATE = 25.0, 200.0
WIDTHS = (1280, 400)
PAIRS = (("tool_mass", "time_delay"), ("gravity_tilt", "bias_jump"))
UNIT = re.compile(r"\d ?(kg|mm|m|deg|N|Nm|%|ms|s|Hz)\b|\d %")
CLIPPED = """
return [...document.querySelectorAll("svg text")].filter((text) => {
  const [inner, outer] = [text.getBoundingClientRect(), text.ownerSVGElement.getBoundingClientRect()];
  return inner.width && (inner.left < 0 || inner.right > document.documentElement.clientWidth
    || inner.top < outer.top - 2 || inner.bottom > outer.bottom + 2);
}).map((text) => text.textContent)"""
WIDE = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"


def cases():
    """Name of the case -> (setup, logs)."""
    found = {}
    for number, name in enumerate(ft.CATALOGUE):
        found[name] = [made({name: {}}, number)]
    for number, pair in enumerate(PAIRS):
        found[" and ".join(pair)] = [made({name: {} for name in pair}, 40 + number)]
    found["nothing"] = [made({}, 50)]
    found["three logs"] = [made({"tool_com": {}}, 60 + k) for k in range(3)]
    found["dry friction, not in the catalogue"] = [rubbing(made({}, 70))]
    found["random steps, not in the catalogue"] = [stepping(made({}, 71))]
    logs = {name: (SETUP, some) for name, some in found.items()}
    logs["a pose instead of joints"] = posed(made({"tool_mass": {}}, 80))
    return logs


def made(effects, seed):
    """Simulate a log with effects of typical size."""
    return ft.simulate(SETUP, effects, duration=DURATION, rate=RATE, seed=seed).log


def rubbing(log):
    """Add a dry-friction force of constant size that opposes the motion of the joints."""
    speed = np.gradient(np.sin(log.q).sum(1), log.t)
    wrench = log.wrench.copy()
    wrench[:, 0] -= 0.8 * np.sign(speed)
    return log._replace(wrench=wrench)


def stepping(log):
    """Add a force that steps to random values at regular intervals."""
    rng = np.random.default_rng(0)
    level = np.repeat(rng.normal(0, 0.8, (50, 3)), len(log.t) // 50 + 1, 0)[: len(log.t)]
    wrench = log.wrench.copy()
    wrench[:, :3] += level
    return log._replace(wrench=wrench)


def posed(log):
    """Convert a log into one with the recorded pose of the flange instead of the joints."""
    q = jnp.asarray(log.q).T
    path = path_of(motions_of(PARAMS.arm, q, q, q))  # rates are dummies, because only the pose is used
    sensor = {"noise_std": np.asarray(SETUP.sensor.noise_std).tolist()}
    tool = {"mass": SETUP.tool.mass, "center_of_mass": SETUP.tool.center_of_mass.tolist()}
    pose = {"orientation": "matrix", "linear": "position"}
    setup = parse_setup({"sensor_pose": pose, "sensor": sensor, "tool": tool})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "log.npz")
        np.savez(file, t=log.t, orientation=path.rotation, position=path.position, wrench=log.wrench)
        return setup, [ft.read_log(file, setup, raw=True)]


def look(browser, page, axe):
    """Return the layout and accessibility faults of a page at every width."""
    found = {}
    for width in WIDTHS:
        browser.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        browser.get(page.as_uri())
        violations = axe.run(browser)["violations"] if axe else []
        found[str(width)] = {
            "wider_than_the_screen_px": browser.execute_script(WIDE),
            "cut_off": browser.execute_script(CLIPPED),
            "axe": [violation["id"] for violation in violations],
        }
    return found


def open_browser():
    """Open a headless Chromium; None if it is not installed."""
    if not (shutil.which("chromium") and shutil.which("chromedriver") and find_spec("selenium")):
        return None
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in ("headless", "no-sandbox", "disable-gpu", "disable-background-networking", "hide-scrollbars"):
        options.add_argument(f"--{flag}")
    return webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    browser = open_browser()
    axe = None
    if browser and find_spec("axe_core_python"):
        from axe_core_python.selenium import Axe

        axe = Axe()
    results = {}
    for name, (setup, logs) in cases().items():
        diagnosis = ft.diagnose(setup, logs)
        page = folder / f"{re.sub('[^a-z_]+', '_', name)}.html"
        diagnosis.to_html(page)
        headline = diagnosis.sentence
        results[name] = {
            "verdict": diagnosis.verdict,
            "headline": headline,
            "words": len(headline.split()),
            "value_and_unit": bool(UNIT.search(headline)),
            "page": look(browser, page, axe) if browser else None,
        }
        print(f"{name}: {len(headline.split())} words: {headline}", results[name]["page"], flush=True)
    if browser:
        browser.quit()
    pages = [page for result in results.values() for page in (result["page"] or {}).values()]
    total = {
        "reports": len(results),
        "most_words": max(result["words"] for result in results.values()),
        "without_value_and_unit": [name for name, result in results.items() if not result["value_and_unit"]],
        "pages_opened": len(pages),
        "wider_than_the_screen": sum(page["wider_than_the_screen_px"] > 0 for page in pages),
        "with_text_cut_off": sum(bool(page["cut_off"]) for page in pages),
        "axe_violations": sum(len(page["axe"]) for page in pages) if axe else None,
    }
    print(total)
    keep(__file__, {"total": total, "reports": results})


if __name__ == "__main__":
    main()
