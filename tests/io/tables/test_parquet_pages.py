"""Sizes of the pages of a Parquet file, read from its footer and from their own headers."""

import numpy as np
import pyarrow as arrow
import pytest
from pyarrow import parquet

from ftbias_jax.errors import LogError
from ftbias_jax.io.budget import Budget
from ftbias_jax.io.tables.parquet import DAMAGE, Thrift, check_pages


def test_a_struct_of_all_that_a_footer_has():
    data = (
        b"\x15\x02"  # field 1: the integer 1
        b"\x18\x03abc"  # field 2: text
        b"\x11"  # field 3: true
        b"\x29\x35\x01\x04\x06"  # field 5: [-1, 2, 3]
        b"\x1c\x16\x08\x00"  # field 6: a struct {1: 4}
        b"\x17" + bytes(8) + b"\x13\x07"  # fields 7 and 8: a double and a byte
        b"\x05\x28\x15"  # field 20, with its number written out: -11
        b"\x00rest"
    )
    thrift = Thrift(data)
    assert thrift.struct() == {1: 1, 2: b"abc", 5: [-1, 2, 3], 6: {1: 4}, 7: None, 8: None, 20: -11}
    assert data[thrift.at :] == b"rest"


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"\x15", b"\x15\xff", b"\x18\x09abc", b"\x19\xf5\xff\xff\x03", b"\x1c" * 100, b"\x1b\x00", b"\x1e"),
        *(b"\x15\x00\x1b" * 20, b"\x15" + b"\xff" * 20),
    ],
)
def test_what_is_none_is_refused(data):
    with pytest.raises(DAMAGE):
        Thrift(data).struct()


def written(path, compression="zstd", **options):
    """Two columns in two row groups, of several pages each."""
    rng = np.random.default_rng(0)
    table = arrow.table({"t": np.arange(30_000.0), "x": rng.integers(0, 9, 30_000).astype(float)})
    parquet.write_table(table, path, compression=compression, row_group_size=20_000, data_page_size=1 << 14, **options)
    return parquet.ParquetFile(path).metadata


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "lz4"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("dictionary", [True, False])
def test_rows_and_bytes_are_what_pyarrow_says_of_them(tmp_path, compression, version, dictionary):
    file = str(tmp_path / "a.parquet")
    options = {"data_page_version": version, "use_dictionary": dictionary, "write_statistics": not dictionary}
    metadata = written(file, compression, **options)
    budget = Budget(file)
    assert check_pages(file, ["t", "x"], budget) == metadata.num_rows == 30_000
    assert budget.limit - budget.bytes == sum(metadata.row_group(i).total_byte_size for i in range(2))


@pytest.mark.parametrize(
    "header", [b"\xff" * 16, b"\x15\x00\x15\x01\x15\x02\x00", b"\x00", b"\x15\x00\x15\x02\x15\x09\x00"]
)
def test_pages_that_are_none_or_leave_their_column_are_damage(tmp_path, header):
    """An invalid struct, a negative or missing size, and one page followed by something else."""
    file = str(tmp_path / "a.parquet")
    start = written(file, use_dictionary=False).row_group(0).column(0).data_page_offset
    content = bytearray((tmp_path / "a.parquet").read_bytes())
    content[start : start + len(header)] = header
    (tmp_path / "a.parquet").write_bytes(content)
    with pytest.raises(LogError, match="is damaged: its pages do not fill their column"):
        check_pages(file, ["t"], Budget(file))
    check_pages(file, ["x"], Budget(file))  # columns that are not read are not checked


def test_a_damaged_footer_is_told(tmp_path):
    """pyarrow ends the process when it is asked for a column of some of these."""
    file = str(tmp_path / "a.parquet")
    written(file)
    content = (tmp_path / "a.parquet").read_bytes()
    length = int.from_bytes(content[-8:-4], "little")
    (tmp_path / "a.parquet").write_bytes(content[: -8 - length] + b"\xff" * length + content[-8:])
    with pytest.raises(LogError, match="is damaged: its footer cannot be read"):
        check_pages(file, ["t"], Budget(file))
