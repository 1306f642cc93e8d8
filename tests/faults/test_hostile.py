"""Files made to do harm, through the command: one line, exit code 1, nothing written and no memory taken."""

import io
import resource
import zipfile

import numpy as np
import pytest
import recordings
from recordings import Wrench
from small_archive import SETUP, named

from ftbias_jax.cli.main import main

T = 50


class Harmful:
    """Runs a command when it is unpickled."""

    def __reduce__(self):
        return eval, ("open('harm', 'w')",)


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Filters a log with a setup; the one line that is printed."""
    monkeypatch.chdir(tmp_path)

    def run(log, setup=SETUP):
        (tmp_path / "setup.toml").write_text(setup)
        before = {path.name for path in tmp_path.iterdir()}
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert main(["filter", str(log), "--setup", "setup.toml", "-o", "out.npz"]) == 1
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 1 << 17  # KiB
        assert {path.name for path in tmp_path.iterdir()} == before
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert printed.err.isprintable() or printed.err[:-1].isprintable()
        return printed.err

    return run


def arrays():
    return {"t": np.arange(T) * 0.01, "q": np.zeros((T, 2)), "wrench": np.ones((T, 6))}


def npy(shape, descr="<f8", data=bytes(100)):
    stream = io.BytesIO()
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + data


def replace_member(path, name, content):
    """A native log with one member replaced or added."""
    np.savez(path, **arrays())
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, old in ({**members, name: content}).items():
            archive.writestr(member, old if member != name else content)


def test_a_zip_bomb(tmp_path, refused):
    replace_member(tmp_path / "log.npz", "q.npy", bytes(300 << 20))
    assert "q.npy: unpacks to 314572800 bytes (more than 100 times looks like a" in refused(tmp_path / "log.npz")


def test_pickled_objects(tmp_path, refused):
    np.savez(tmp_path / "log.npz", **{**arrays(), "q": np.array([[Harmful()] * 2] * T, object)})
    assert "q: holds Python objects (save plain arrays" in refused(tmp_path / "log.npz")


@pytest.mark.parametrize(
    "definition",
    ['<!ENTITY a "bbbbbbbbbb"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">', '<!ENTITY a SYSTEM "file:///etc/passwd">'],
)
def test_xml_entities(tmp_path, refused, definition):
    (tmp_path / "arm.urdf").write_text(f"<!DOCTYPE robot [{definition}]><robot name='&a;'><link name='base'/></robot>")
    np.savez(tmp_path / "log.npz", **arrays())
    setup = '[robot]\nurdf = "arm.urdf"\ntip_link = "tip"\n' + SETUP[SETUP.index("[sensor]") :]
    assert "arm.urdf: has a document type" in refused(tmp_path / "log.npz", setup)


def test_markup_and_control_characters_in_frames_and_topics(tmp_path, refused):
    """They come back as text in messages, without what a terminal or a page would run."""
    frame = "<script>alert(1)</script>\x1b[2J\n"
    two = [
        m._replace(frame=frame * (i % 2), topic="/w\x1b[2J") if isinstance(m, Wrench) else m
        for i, m in enumerate(recordings.messages())
    ]
    path = recordings.write(tmp_path, "mcap", two)
    assert "the wrenches of /w?[2J are in several frames" in refused(path, named())
