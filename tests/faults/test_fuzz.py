"""Files of every format with random damage: a part is read, or a typed error, in bounded time and memory."""

from contextlib import suppress

import log_files
import numpy as np
import pytest
import recordings
from bounded import bounded
from recordings import FORMATS

from ftbias_jax.errors import FtbiasError, LogError
from ftbias_jax.fleet.manifest import read_manifests
from ftbias_jax.fleet.result_page import read_result, result_page
from ftbias_jax.io import read_log
from ftbias_jax.io.draft.dh_table import DhTable, from_table
from ftbias_jax.io.draft.table import look
from ftbias_jax.io.tables.poses import read_poses
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.urdf import load_urdf

MUTANTS = 300
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


def mutate(content, rng):
    """A few flipped bits, a cut, an inserted or a repeated piece."""
    content = bytearray(content)
    kind, at = rng.integers(4), int(rng.integers(len(content)))
    if kind == 0:
        for i in rng.integers(len(content), size=rng.integers(1, 9)):
            content[i] ^= 1 << rng.integers(8)
    elif kind == 1:
        del content[at:]
    elif kind == 2:
        content[at:at] = rng.bytes(int(rng.integers(1, 40)))
    else:
        content[at : at + 8] = rng.choice([b"\xff" * 8, bytes(8), b"\x00\x00\x00\x80\x00\x00\x00\x00"])
    return bytes(content)


def originals(tmp_path):
    """One small file of every format."""
    log = recordings.arrays(40)
    table = {"t": np.arange(20) * 0.02, "q": log["q"], "wrench": log["wrench"][::2]}
    np.savez_compressed(tmp_path / "log.npz", **log)
    yield tmp_path / "log.npz"
    yield log_files.write(tmp_path / "log.h5", log, compression="gzip")
    yield from (log_files.write(tmp_path / f"log{suffix}", table) for suffix in (".csv", ".parquet"))
    for kind in FORMATS:
        if kind == "folder":
            continue
        (tmp_path / kind).mkdir()
        path = recordings.write(tmp_path / kind, kind, recordings.messages(log))
        yield next(path.glob("*.zstd")) if path.is_dir() else path


@pytest.fixture(autouse=True)
def _little_memory():
    """All mutants together take at most 1 GiB of additional memory."""
    with bounded(np.inf, 1024):
        yield


def test_mutants_of_every_format_of_logs(tmp_path, setup):
    rng, read = np.random.default_rng(0), 0
    for path in list(originals(tmp_path)):
        content = path.read_bytes()
        for _ in range(MUTANTS):
            path.write_bytes(mutate(content, rng))
            with bounded(20):
                for how in (False, True):
                    with suppress(LogError):
                        read_log(path, setup, salvage=how)
                        read += 1
                with suppress(LogError):
                    look(str(path))
    assert read > MUTANTS  # the mutations are mild enough that something is read


def test_mutants_of_setups_robots_poses_results_and_manifests(tmp_path, setup):
    urdf = """<robot name="two"><link name="base"/><link name="tool0"/><joint name="pan" type="revolute">
        <parent link="base"/><child link="tool0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="2"/>
        </joint></robot>"""
    log = recordings.arrays(40)
    poses = np.column_stack([log["q"][:20, :2], log["wrench"][:20]])
    setup.save(tmp_path / "setup.toml")
    (tmp_path / "arm.urdf").write_text(urdf)
    (tmp_path / "dh.csv").write_text("a,alpha,d,theta\n0.1,1.57,0.2,0\n0.3,0,0,0\n")
    np.savetxt(tmp_path / "poses.csv", poses, delimiter=",", header="q0,q1,fx,fy,fz,tx,ty,tz", comments="")
    result = {name: np.ones((9, 6)) for name in ("bias", "bias_std", "wrench_unbiased", "wrench_tool")}
    np.savez(tmp_path / "result.npz", t=np.arange(9.0), **result)
    line = '{"path": "a.npz", "status": "ok", "samples": 9, "seconds": 0.1, "start": 1.0, "job": "filter"}\n'
    (tmp_path / "manifest.filter.jsonl").write_text(9 * line)
    readers = {
        "setup.toml": load_setup,
        "arm.urdf": lambda path: load_urdf(str(path)),
        "dh.csv": lambda path: from_table(DhTable(str(path), "standard", "m,rad")),
        "poses.csv": lambda path: read_poses(path, setup),
        "result.npz": lambda path: result_page(read_result(str(path)), "result"),
        "manifest.filter.jsonl": lambda path: read_manifests(str(path.parent)),
    }
    rng = np.random.default_rng(1)
    for name, reader in readers.items():
        path = tmp_path / name
        reader(path)
        content = path.read_bytes()
        for _ in range(MUTANTS):
            path.write_bytes(mutate(content, rng))
            with bounded(20), suppress(FtbiasError):
                reader(path)
        path.write_bytes(content)
