import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from one_line import reading_fails as fails

from ftbias_jax.io import read_log
from ftbias_jax.io.tables import csv as csv_log
from ftbias_jax.io.tables import first_lines
from ftbias_jax.io.tables.columns import choose_columns

HEADER = "t,q0,q1,dq0,dq1,fx,fy,fz,tx,ty,tz,temperature"
LINE = "0.{i},1,2,3,4,5,6,7,8,9,10,25"


def write(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8", newline="")
    return path


def lines(count=3, header=HEADER, line=LINE):
    return [header, *(line.format(i=i) for i in range(count))]


@pytest.fixture
def plain(tmp_path, setup):
    log = read_log(write(tmp_path, "\n".join(lines())), setup)
    np.testing.assert_array_equal(log.t, [0, 0.1, 0.2])
    np.testing.assert_array_equal(np.column_stack([log.q, log.dq, log.wrench]), [np.arange(1, 11)] * 3)
    np.testing.assert_array_equal(log.temperature, [25] * 3)
    return log


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: "# " + text,
        lambda text: text + "\n\n  \n",
        lambda text: text.replace("\n", "\n\n"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace(",q0", ',"q0"').replace("0.1,", '"0.1",'),
    ],
    ids=["windows", "byte order mark", "savetxt", "blank end", "blank lines", "spaces", "quotes"],
)
def test_the_usual_variants_of_csv_read_the_same(tmp_path, setup, plain, change):
    varied = read_log(write(tmp_path, change("\n".join(lines()))), setup)
    for a, b in zip(plain, varied, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "header",
    [
        "time,q1,q2,dq1,dq2,fx,fy,fz,mx,my,mz,temperature",
        "t,base,elbow,velocity_base,velocity_elbow,fx,fy,fz,tx,ty,tz,temperature",
        "t,position_base,position_elbow,dq0,dq1,fx,fy,fz,tx,ty,tz,temperature",
    ],
)
def test_usual_names_need_no_declaration(tmp_path, setup, plain, header):
    named = read_log(write(tmp_path, "\n".join(lines(header=header))), setup)
    for a, b in zip(plain, named, strict=True):
        np.testing.assert_array_equal(a, b)


def test_columns_in_any_order_beside_others_as_the_setup_names_them(tmp_path, make_setup):
    columns = {"time": "stamp", "position": ["elbow angle", "b"], "velocity": ["v1", "v0"], "wrench": list("UVWXYZ")}
    setup = make_setup(log={"columns": columns})
    header = "state,stamp,b,elbow angle,v0,v1,U,V,W,X,Y,Z"
    log = read_log(write(tmp_path, "\n".join(lines(header=header, line="idle,0.{i},1,2,3,4,5,6,7,8,9,10"))), setup)
    np.testing.assert_array_equal(log.q, [[2, 1]] * 3)
    np.testing.assert_array_equal(log.dq, [[4, 3]] * 3)
    assert np.isnan(log.temperature).all()


def test_empty_cells_are_a_merged_timeline(tmp_path, setup):
    header = "temperature," + HEADER.removesuffix(",temperature")
    text = "\n".join([header, ",0,1,2,,,,,,,,", ",0.5,,, ,\t,5,6,7,8,9,10", "25,1,3,4,NaN,nan,,,,,,"])
    log = read_log(write(tmp_path, text), setup)
    np.testing.assert_array_equal(log.q, [[1, 2], [np.nan, np.nan], [3, 4]])
    assert np.isnan(log.dq).all()
    np.testing.assert_array_equal(log.wrench[:, 0], [np.nan, 5, np.nan])
    np.testing.assert_array_equal(log.temperature, [np.nan, np.nan, 25])


LARGEST = 9e19  # values that no sensor has are refused from 1e20 on
numbers = arrays(np.float64, (6, 8), elements=st.floats(-LARGEST, LARGEST) | st.just(np.nan))


@given(numbers, st.sampled_from([40, 1 << 22]))
def test_written_numbers_come_back_to_the_last_bit_in_blocks_of_any_size(tmp_path_factory, setup, values, block):
    values[0] = 1  # at least one sample of everything
    rows = [f"{i / 10}," + ",".join("" if np.isnan(v) else repr(float(v)) for v in row) for i, row in enumerate(values)]
    path = write(tmp_path_factory.mktemp("csv"), "\n".join(["t,base,elbow,fx,fy,fz,tx,ty,tz", *rows]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_log, "BLOCK", block)
        log = read_log(path, setup, raw=True)
    np.testing.assert_array_equal(np.hstack([log.q, log.wrench]), values)


@pytest.mark.parametrize("block", [40, 1 << 22])
@pytest.mark.parametrize("cell", ["abc", "1_000", "0x10", "1,5", "--1", "1e", "٣", "1 2"])
def test_bad_cells_are_named_with_their_line(tmp_path, setup, monkeypatch, cell, block):
    monkeypatch.setattr(csv_log, "BLOCK", block)
    content = lines(5)
    content[3] = content[3].replace(",5,", f",{cell},")
    if cell == "1,5":
        fails(write(tmp_path, "\n".join(content)), setup, "line 4: 13 cells, the header has 12", "one cell per column")
    else:
        where = f"line 4, column fx: {cell!r} is not a number"
        fails(write(tmp_path, "\n".join(content)), setup, where, "leave the cell empty")


def test_the_line_of_a_bad_cell_counts_blank_lines(tmp_path, setup):
    content = "\n\n".join(lines(3)).replace("0.2,", "now,")
    fails(write(tmp_path, content), setup, "line 7, column t: 'now'")


@pytest.mark.parametrize(
    ("header", "what", "remedy"),
    [
        (
            "s,q0,q1,fx,fy,fz,tx,ty,tz",
            "time: no columns for the time: looked for t, time or timestamp; the header has s, q0",
            "= ",
        ),
        (
            "t,a,b,fx,fy,fz,tx,ty,tz",
            "of every joint (2 joints: base, elbow); the header has t, a, b",
            "[log.columns] position = ",
        ),
        ("t,q0,q1,q2,fx,fy,fz,tx,ty,tz", "position: no columns for the position", "[log.columns] position = "),
        ("t,q0,q1,dq0,dq1,dq2,fx,fy,fz,tx,ty,tz", "velocity: no columns", "[log.columns] velocity = "),
        ("t,q0,q1,dq1,fx,fy,fz,tx,ty,tz", "velocity: no columns", "[log.columns] velocity = "),
        (
            "t,q0,q1,fx,fy,fz",
            "looked for fx fy fz tx ty tz, force_x ... torque_z",
            "[log.columns] wrench = ",
        ),
        ("", "the header has ", "[log.columns] time = "),
        ("t,q0,q1,fx,fy,fz,tx,ty,tz,fx", "fx: two columns have this name", "rename one of them"),
    ],
)
def test_columns_that_are_not_there_are_named(tmp_path, setup, header, what, remedy):
    fails(write(tmp_path, header + "\n"), setup, what, remedy)


def test_a_declared_column_that_is_not_there_names_the_nearest(tmp_path, make_setup):
    setup = make_setup(log={"columns": {"time": "stanp"}})
    path = write(tmp_path, "stamp,q0,q1,fx,fy,fz,tx,ty,tz\n")
    fails(path, setup, "stanp: log.columns.time of the setup", "did you mean 'stamp'?")


def test_counted_joints_go_on_without_being_mistaken(setup):
    header = ["t", "q1", "q2", "fx", "fy", "fz", "tx", "ty", "tz"]
    columns = choose_columns(header, ["position", "velocity", "wrench", "temperature"], setup)
    assert columns["q"] == ("q1", "q2")
    assert columns["dq"] == ()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (HEADER.encode() + b"\n\xff\xfe", "is not UTF-8 text"),
        (HEADER.encode() + b"\n" + b"1" * 200_000 + b'"\n', "is not CSV text"),
        (HEADER.encode() + b"\n", "t: has 0 samples"),
        (None, "cannot be read: No such file"),
    ],
    ids=["encoding", "endless cell", "no lines", "absent"],
)
def test_files_that_are_no_csv_are_named(tmp_path, setup, content, what):
    path = tmp_path / "log.csv"
    if content is not None:
        path.write_bytes(content)
    fails(path, setup, what)


def test_a_file_of_comments_alone_is_not_read_to_its_end(tmp_path, setup):
    fails(write(tmp_path, "\n".join(["0.1|0.2"] * 2000)), setup, "no columns for the", "the header has 0.1|0.2")


def test_comments_may_come_first_whether_or_not_the_last_has_the_names(tmp_path, setup, plain):
    header, *rows = lines()
    befores = [
        "# arm: left\n# 2 joints, 3 samples\n",
        "# arm: left\n\n# ",
        "sep=,\n",
        "recording\n\nleft\n",
        "// a, b\n// ",
    ]
    for before in (f"{text}{header}" for text in befores):
        varied = read_log(write(tmp_path, "\n".join([before, *rows])), setup)
        for a, b in zip(plain, varied, strict=True):
            np.testing.assert_array_equal(a, b)
    fails(
        write(tmp_path, "\n".join(["# arm: left", *lines(), "0.3,abc" + 10 * ",1"])), setup, "line 6, column q0: 'abc'"
    )


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".tsv", ".dat"])
def test_columns_without_names_are_counted(tmp_path, make_setup, plain, suffix):
    columns = {"time": "1", "position": ["2", "3"], "velocity": ["4", "5"], "wrench": [*list("6789"), "10", "11"]}
    setup = make_setup(log={"columns": columns})
    rows = lines()[1:]
    log = read_log(write(tmp_path, "\n".join(rows), f"log{suffix}"), setup)
    np.testing.assert_array_equal(np.column_stack([log.t, log.q, log.dq, log.wrench]), [
        [t, *range(1, 11)] for t in (0, 0.1, 0.2)
    ])  # fmt: skip
    spaces = read_log(write(tmp_path, "\n".join(row.replace(",", "  ") for row in rows), f"log{suffix}"), setup)
    np.testing.assert_array_equal(spaces.wrench, log.wrench)
    counted = ",".join(map(str, range(12)))  # by pandas
    setup = make_setup(log={"columns": {key: _less(names) for key, names in columns.items()}})
    np.testing.assert_array_equal(read_log(write(tmp_path, "\n".join([counted, *rows])), setup).wrench, log.wrench)


def _less(names):
    return str(int(names) - 1) if isinstance(names, str) else [_less(name) for name in names]


def row_of_lists(start, brackets="[]", between=", ", quote='"'):
    def cell(values):
        return f"{quote}{brackets[0]}{between.join(map(str, values))}{brackets[1]}{quote}"

    return [cell(range(start, start + 2)), cell(range(start + 2, start + 8))]


@pytest.mark.parametrize(
    "style",
    [{}, {"quote": ""}, {"brackets": "()"}, {"between": " ", "quote": ""}, {"between": " \n  "}],
    ids=["quoted", "bare", "tuple", "numpy", "wrapped"],
)
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("block", [40, 1 << 22])
def test_cells_that_are_lists_are_columns_of_their_entries(tmp_path, setup, monkeypatch, style, delimiter, block):
    monkeypatch.setattr(csv_log, "BLOCK", block)
    monkeypatch.setattr(first_lines, "LONGEST", 150)
    content = [("t", "q", "ft"), ("0.0", row_of_lists(0, **style)[0], "")]
    content += [(f"0.{i}", *row_of_lists(i, **style)) for i in range(1, 9)]
    log = read_log(write(tmp_path, "\n".join(map(delimiter.join, content))), setup)
    np.testing.assert_array_equal(log.q, [[i, i + 1] for i in range(9)])
    np.testing.assert_array_equal(log.wrench, [[np.nan] * 6, *([i + j for j in range(2, 8)] for i in range(1, 9))])


def test_lists_of_another_length_are_an_error(tmp_path, setup):
    content = [
        "t,q,ft",
        *(",".join(["0.1", *row_of_lists(0)]) for _ in range(3)),
        '0.4,"[1, 2, 3]","[1, 2, 3, 4, 5, 6]"',
    ]
    fails(write(tmp_path, "\n".join(content)), setup, "line 5: 10 cells, the header has 9")


@pytest.mark.parametrize(
    "date", ["2024-03-01T12:00:{}.{}00Z", "2024-03-01 12:00:{}.{}", "2024/03/01 13:00:{}.{}+01:00"]
)
@pytest.mark.parametrize("delimiter", [",", ";", " "])
def test_dates_are_stamps(tmp_path, setup, date, delimiter):
    header, *rows = (line.replace(",", delimiter) for line in lines(30, line="{i}" + LINE[len("0.{i}") :]))
    rows = [row.replace(str(i), date.format(f"{i // 10:02}", i % 10), 1) for i, row in enumerate(rows)]
    rows[10] = rows[10].replace(f".0{'00' * ('Z' in date)}", "", 1)  # isoformat leaves out a fraction of zero
    if delimiter == ";":
        rows = [row.replace(".", ",") for row in rows]
    log = read_log(write(tmp_path, "\n".join([header, *rows])), setup)
    assert log.start == pytest.approx(1709294400)
    np.testing.assert_allclose(log.t, 0.1 * np.arange(30), atol=1e-6)


@pytest.mark.parametrize("date", ["", "31.12.2024 ", "3/1/2024 "])
@pytest.mark.parametrize("delimiter", [",", ";", " "])
def test_times_of_a_day_go_on_after_midnight(tmp_path, setup, date, delimiter):
    header, *rows = (line.replace(",", delimiter) for line in lines(30, line="{i}" + LINE[len("0.{i}") :]))
    clock = [86398.5 + 0.1 * i for i in range(30)]
    times = [f"{date}{int(t // 3600 % 24)}:{int(t // 60 % 60):02}:{t % 60:04.1f}" for t in clock]
    rows = [row.replace(str(i), times[i], 1) for i, row in enumerate(rows)]
    if delimiter == ";" and not date:
        rows = [row.replace(".", ",") for row in rows]
    log = read_log(write(tmp_path, "\n".join([header, *rows])), setup)
    np.testing.assert_allclose(log.t, 0.1 * np.arange(30), atol=1e-6)


def test_what_is_no_date_is_told(tmp_path, setup):
    fails(
        write(tmp_path, "\n".join([HEADER, "2024-13-01T12:00:00" + 11 * ",1"])), setup, "'2024-13-01T12:00:00' is not a"
    )


def test_seconds_and_nanoseconds_beside_each_other_are_stamps(tmp_path, setup, plain):
    for names in ("secs,nsecs", "header.stamp.sec,header.stamp.nanosec"):
        header, *rows = lines(line="1600000000,{i}00000000" + LINE[len("0.{i}") :], header=names + HEADER[1:])
        log = read_log(write(tmp_path, "\n".join([header, *rows])), setup)
        np.testing.assert_allclose(log.t, plain.t, atol=1e-6)
        np.testing.assert_array_equal(log.wrench, plain.wrench)
    header, *rows = lines(line="0.{i},7,8" + LINE[len("0.{i}") :], header="t,sec,nsec" + HEADER[1:])
    np.testing.assert_array_equal(read_log(write(tmp_path, "\n".join([header, *rows])), setup).t, plain.t)


STAMP = "1600000000,{i}00000000"
POSITIONS, VELOCITIES, WRENCH = "1.0,2.0", "3.0,4.0", "5.0,6.0,7.0,8.0,9.0,10.0"


@pytest.mark.parametrize(
    ("lists", "velocities"),
    [(f"{POSITIONS},{VELOCITIES},0.0,0.0", True), (f"{POSITIONS},{VELOCITIES},", True), (f"{POSITIONS},,", False)],
    ids=["all", "no efforts", "positions alone"],
)
def test_messages_of_ros_2_as_tables_have_the_names_of_their_fields(tmp_path, make_setup, plain, lists, velocities):
    setup = make_setup(log={"files": {"position": "log_joints.csv", "wrench": "log.csv"}})
    rows = [f"{STAMP},,base,elbow,{lists}".format(i=i) for i in range(3)]
    write(tmp_path, "\n".join(rows), "log_joints.csv")
    log = read_log(write(tmp_path, "\n".join(f"{STAMP},tool0,{WRENCH}".format(i=i) for i in range(3))), setup)
    np.testing.assert_allclose(log.t, plain.t, atol=1e-6)
    for name in ("q", "dq", "wrench") if velocities else ("q", "wrench"):
        np.testing.assert_array_equal(getattr(log, name), getattr(plain, name))


def test_a_line_of_numbers_and_words_is_no_header(tmp_path, make_setup, plain):
    setup = make_setup(log={"columns": {"time": "1", "position": ["3", "4"], "wrench": [*list("56789"), "10"]}})
    rows = [f"0.{i},moving,{POSITIONS},{WRENCH},ok" for i in range(3)]
    log = read_log(write(tmp_path, "\n".join(rows)), setup)
    for name in ("t", "q", "wrench"):
        np.testing.assert_array_equal(getattr(log, name), getattr(plain, name))
