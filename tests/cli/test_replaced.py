"""Files that a command replaces: its own earlier outputs of the same kind, and others only with --force."""

import argparse
import os
import shlex

import numpy as np
import pytest
from small_archive import SETUP, write_log

from ftbias_jax.cli.main import build_parser, main
from ftbias_jax.filtering.quality.plot import new_figure, save_figure
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.write import npz, outputs, table
from ftbias_jax.io.write.mcap import LAYOUTS, layout
from ftbias_jax.io.write.provenance import in_words, provenance
from ftbias_jax.io.write.selection import About
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.export.ros import dump_offsets

LOG = "log.npz --setup setup.toml"
OUTPUTS = {
    ("filter", "output"): f"filter {LOG} -o {{}}.npz",
    ("filter", "plot"): f"filter {LOG} -o new.npz --plot {{}}.png",
    ("filter", "offsets"): f"filter {LOG} -o new.npz --offsets {{}}.yaml",
    ("tune", "output"): f"tune {LOG} -o {{}}.toml",
    ("identify", "output"): f"identify {LOG} -o {{}}.toml",
    ("check", "json"): f"check {LOG} --json {{}}.json",
    ("check", "output"): f"check {LOG} -o {{}}",
    ("calibrate", "output"): f"calibrate {LOG} -o {{}}.toml",
    ("calibrate", "json"): f"calibrate {LOG} -o new.toml --json {{}}.json",
    ("calibrate", "html"): f"calibrate {LOG} -o new.toml --html {{}}.html",
    ("simulate", "output"): "simulate --setup setup.toml -o {}.npz",
    ("simulate", "truth"): "simulate --setup setup.toml -o new.npz --truth {}.json",
    ("plan", "output"): "plan --setup setup.toml -o {}.csv",
    ("plan", "json"): "plan --setup setup.toml -o new.csv --json {}.json",
    ("plan", "html"): "plan --setup setup.toml -o new.csv --html {}.html",
    ("plan", "ros"): "plan --setup setup.toml -o new.csv --ros {}.yaml",
    ("plan", "bag"): "plan --setup setup.toml -o new.csv --bag {}.mcap",
    ("plan", "ur"): "plan --setup setup.toml -o new.csv --ur {}.script",
    ("plan", "franka"): "plan --setup setup.toml -o new.csv --franka {}.json",
    ("replay", "output"): f"replay {LOG} -o {{}}.npz",
    (
        "validate-sim",
        "json",
    ): f"validate-sim {LOG} --found setup.toml --mended setup.toml --json {{}}.json",
    ("diagnose", "json"): f"diagnose {LOG} --json {{}}.json",
    ("diagnose", "html"): f"diagnose {LOG} --html {{}}.html",
    ("diagnose", "output"): f"diagnose {LOG} --apply -o {{}}.toml",
    ("export", "output"): "export --format foxglove -o {}.toml",
    ("report", "output"): "report log.npz -o {}.html",
    ("setup", "output"): "setup --robot panda -o {}.toml",
}
"""Command and option -> arguments with a placeholder for the output's name."""
CHECKED_ELSEWHERE = {("demo", "output"), ("sample", "output")}
"""Options for a folder that must be new or a demonstration's (test_outputs.py) or empty (simulators/test_sample.py)."""
NAMES = {"output", "json", "html", "plot", "offsets", "truth", "out", "ros", "bag", "ur", "franka"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "log.npz")
    (tmp_path / "setup.toml").write_text(SETUP)
    return tmp_path


def options(parser, command=""):
    """(command, name) of every option that names what is written."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from options(inner, command or name)
        elif action.dest in NAMES:
            yield command, action.dest


def test_every_option_that_names_an_output_is_tried_here():
    assert set(options(build_parser())) == OUTPUTS.keys() | CHECKED_ELSEWHERE


@pytest.mark.parametrize("key", OUTPUTS, ids=" ".join)
def test_somebody_elses_file_is_not_replaced(folder, capsys, key):
    words = shlex.split(OUTPUTS[key].format("mine"))
    if key == ("check", "output"):
        (folder / "mine").mkdir()
        name = folder / "mine" / "log.check.json"
    else:
        name = folder / next(word for word in words if word.startswith("mine"))
    name.write_bytes(b"[somebody's work]\n")
    assert main(words) in (1, 2)
    assert "is there already" in capsys.readouterr().err
    assert name.read_bytes() == b"[somebody's work]\n"
    assert not (folder / "new.npz").exists()


@pytest.mark.parametrize("key", OUTPUTS, ids=" ".join)
def test_nothing_is_written_through_a_link(folder, capsys, key):
    words = shlex.split(OUTPUTS[key].format("mine"))
    (folder / "treasure").write_bytes(b"treasure")
    if key == ("check", "output"):
        (folder / "mine").mkdir()
        os.symlink(folder / "treasure", folder / "mine" / "log.check.json")
    else:
        os.symlink(folder / "treasure", folder / next(word for word in words if word.startswith("mine")))
    assert main([*words, *(() if key[0] == "setup" else ("--force",))]) != 0
    assert (folder / "treasure").read_bytes() == b"treasure"


def test_a_folder_of_logs_does_not_replace_what_it_has_not_written(folder, capsys):
    write_log(folder / "run" / "rec.npz", 1)
    write_log(folder / "rec.npz", 2)
    before = (folder / "rec.npz").read_bytes()
    assert main(["filter", "run/rec.npz", "--setup", "setup.toml", "-o", "."]) != 0
    assert (folder / "rec.npz").read_bytes() == before
    assert main(["filter", "run", "--setup", "setup.toml", "-o", "out"]) == 0
    written = (folder / "out" / "rec.npz").read_bytes()
    write_log(folder / "run" / "rec.npz", 3)
    assert main(["filter", "run", "--setup", "setup.toml", "-o", "out"]) == 0  # a result of its own
    assert (folder / "out" / "rec.npz").read_bytes() != written


def test_every_kind_is_known_again_and_told_from_others(folder, make_diagnosis):
    setup = load_setup("setup.toml")
    origin = provenance(setup, [], {})
    rows = {"t": np.arange(3.0), "bias": np.zeros((3, 6))}
    about = About(origin=origin)
    npz.save_npz("result.npz", rows | npz.texts_of(rows, about))
    table.save_csv("result.csv", rows, about)
    made = {"t": np.arange(3.0), "wrench": np.zeros((3, 6))}
    npz.save_npz("log_made.npz", made | npz.texts_of_log(made, "wrench_on_tool", origin))
    make_diagnosis().to_json("diagnosis.json")
    make_diagnosis().to_html("diagnosis.html")
    setup.save("written.toml", by="tune")
    save_figure("figure.png", new_figure())
    save_figure("figure.svg", new_figure())
    save_figure("figure.pdf", new_figure())
    offsets = dump_offsets(np.zeros(6), remark=in_words(provenance(setup, [], {})))
    write_atomic("offsets.yaml", lambda file: file.write(offsets.encode()))
    for name in LAYOUTS:
        (folder / f"{name}.xml").write_text(layout(name))
    assert main(["check", "log.npz", "--setup", "setup.toml", "--json", "check.json"]) in (0, 1)
    found = {path.name: outputs.kind_of(path) for path in folder.iterdir()}
    assert found == {
        "result.npz": outputs.RESULT,
        "result.csv": outputs.RESULT,
        "result.csv-metadata.json": "",
        "log_made.npz": outputs.LOG,
        "diagnosis.json": outputs.DIAGNOSIS,
        "diagnosis.html": outputs.PAGE,
        "written.toml": outputs.SETUP,
        "figure.png": outputs.FIGURE,
        "figure.svg": outputs.FIGURE,
        "figure.pdf": outputs.FIGURE,
        "offsets.yaml": outputs.EXPORT,
        **{f"{name}.xml": outputs.EXPORT for name in LAYOUTS},
        "check.json": outputs.CHECK,
        "log.npz": "",
        "setup.toml": "",
    }


def test_a_setup_of_a_command_is_replaced_by_it_and_one_that_was_edited_in_place_stays_its_owners(folder):
    load_setup("setup.toml").save("made.toml", by="tune")
    first = (folder / "made.toml").read_text()
    load_setup("made.toml").save("made.toml", by="tune")
    assert (folder / "made.toml").read_text() == first
    assert load_setup("made.toml").tool.mass == 0.7
    load_setup("made.toml").save("own.toml")
    assert outputs.kind_of("own.toml") == ""


def test_with_force_a_file_of_another_kind_is_replaced(folder):
    (folder / "layout.json").write_text("{}")
    assert main(["export", "--format", "foxglove", "-o", "layout.json"]) == 1
    assert main(["export", "--format", "foxglove", "-o", "layout.json", "--force"]) == 0
    assert main(["export", "--format", "foxglove", "-o", "layout.json"]) == 0


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\xff" * 100, b"{", b"[" * 99999])
@pytest.mark.parametrize("suffix", [".npz", ".csv", ".json", ".parquet", ".html", ".png", ".toml", ".mcap", ""])
def test_no_file_is_taken_for_ours_by_chance_or_stops_the_look(folder, suffix, content):
    path = folder / f"odd{suffix}"
    path.write_bytes(content)
    assert outputs.kind_of(path) == ""
    assert outputs.kind_of(folder / "missing.npz") == ""
