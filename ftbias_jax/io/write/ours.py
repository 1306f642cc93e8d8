"""Which files this program wrote, and as what: the only ones that it replaces without being told to."""

import json
import os
import zipfile
from typing import Any

from ftbias_jax.errors import LogError
from ftbias_jax.io.tables.array_files import load_arrays
from ftbias_jax.io.write.fields import SIGN
from ftbias_jax.io.write.table import companion
from ftbias_jax.setup.save import WRITTEN_BY

RESULT, LOG, SETUP, PAGE, FIGURE, EXPORT = "a result", "a log", "a setup", "a page", "a figure", "an export"
DIAGNOSIS, CHECK, SCORE, CALIBRATION, PLAN = "a diagnosis", "a check", "a score", "a calibration", "a plan"
END = 1 << 16
"""Bytes at either end of a file that are looked at."""
GENERATOR = b'<meta name="generator" content="ftbias_jax'
IN_JSON = {
    DIAGNOSIS: (b'"schema"', b'"verdict"', b'"sentence"'),
    CHECK: (b'"ok"', b'"findings"'),
    CALIBRATION: (b'"kept"', b'"forecast"'),
    SCORE: (b'"versions"', b'"logs"'),
    PLAN: (b'"expected_std"', b'"largest_share"'),
    LOG: (b'"provenance"', b'"effects"'),
}
"""Kind -> what stands at the beginning of its JSON."""
FOR_OTHERS = (b"by ftbias_jax ", b'"/ftbias/')
"""In what is exported for other programs: where it comes from, or the topics that layouts show."""


def kind_of(path: str | os.PathLike[str]) -> str:
    """What this program wrote a file as, such as RESULT; "" = it did not, or nothing shows it."""
    file = os.fspath(path)
    try:
        with open(file, "rb") as stream:
            head = stream.read(END)
            stream.seek(max(os.fstat(stream.fileno()).st_size - END, 0))
            tail = stream.read(END)
    except OSError:
        return ""
    suffix = os.path.splitext(file)[1].lower()
    if suffix == ".toml":
        return SETUP if head.startswith(WRITTEN_BY.encode()) else ""
    if any(words in head for words in FOR_OTHERS):
        return EXPORT
    match suffix:
        case ".npz":
            return _of_arrays(file)
        case ".csv":
            return RESULT if _is_ours(companion(file)) else ""
        case ".parquet" | ".mcap":
            return RESULT if b"ftbias" in head + tail else ""
        case ".json":
            return next((kind for kind, words in IN_JSON.items() if all(word in head for word in words)), "")
        case ".html":
            return PAGE if GENERATOR in head else ""
        case ".png" | ".svg" | ".pdf":
            return FIGURE if b"ftbias_jax" in head + tail else ""
    return ""


def _is_ours(metadata: str) -> bool:
    try:
        with open(metadata, "rb") as stream:
            return json.dumps(SIGN).encode() in stream.read(END)
    except OSError:
        return False


def _of_arrays(file: str) -> str:
    try:
        if "about.npy" not in zipfile.ZipFile(file).namelist():
            return ""
        about: Any = json.loads(str(load_arrays(file, ("about",))["about"]))
    except (LogError, OSError, zipfile.BadZipFile, KeyError, ValueError, RecursionError):
        return ""
    known = about.keys() if isinstance(about, dict) else ()
    return RESULT if "fields" in known else LOG if "reports" in known else ""
