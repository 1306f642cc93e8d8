"""Sizes of the pages of a Parquet file, read from their own headers."""

import mmap

import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io.limits.parquet_pages import Page, check_pages, page_at, pages_of, row_groups

arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


def written(path, compression="zstd", **options):
    """Two columns in two row groups, of several pages each."""
    rng = np.random.default_rng(0)
    table = arrow.table({"t": np.arange(30_000.0), "x": rng.integers(0, 9, 30_000).astype(float)})
    parquet.write_table(table, path, compression=compression, row_group_size=20_000, data_page_size=1 << 14, **options)
    return parquet.ParquetFile(path).metadata


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "lz4"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("dictionary", [True, False])
def test_the_pages_of_a_column_are_what_its_footer_says(tmp_path, compression, version, dictionary):
    options = {"data_page_version": version, "use_dictionary": dictionary, "write_statistics": not dictionary}
    metadata = written(tmp_path / "a.parquet", compression, **options)
    with (
        open(tmp_path / "a.parquet", "rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content,
    ):
        groups = row_groups(str(tmp_path / "a.parquet"))
        assert len(groups) == metadata.num_row_groups == 2
        for i, group in enumerate(groups):
            theirs = metadata.row_group(i)
            assert (group.rows, group.unpacked) == (theirs.num_rows, theirs.total_byte_size)
            assert len(group.chunks) == theirs.num_columns == 2
            for j, chunk in enumerate(group.chunks):
                expected = theirs.column(j)
                assert chunk.name == expected.path_in_schema
                assert (chunk.stored, chunk.unpacked) == (
                    expected.total_compressed_size,
                    expected.total_uncompressed_size,
                )
                pages = list(pages_of(content, chunk, "a.parquet"))
                assert len(pages) > 1
                assert sum(page.header + page.stored for page in pages) == chunk.stored
                assert sum(page.header + page.unpacked for page in pages) == chunk.unpacked
    check_pages(str(tmp_path / "a.parquet"), groups, {"t", "x"})


def header(unpacked, stored=100):
    """Of a data page, with a struct that has all that can stand in one."""
    inner = b"\x15\x02\x15\x00\x18\x03abc\x29\x35\x02\x04\x06\x11\x12\x00"
    return b"\x15\x00\x15" + zigzag(unpacked) + b"\x15" + zigzag(stored) + b"\x2c" + inner + b"\x00"


def zigzag(number):
    number, out = (number << 1) ^ (number >> 63), b""
    while number > 127:
        out, number = out + bytes([number & 127 | 128]), number >> 7
    return out + bytes([number])


def test_a_header_is_read_to_its_end():
    data = header(5, 100)
    assert page_at(data + b"rest") == Page(len(data), 100, 5)
    assert page_at(header(2**31 - 1)).unpacked == 2**31 - 1


@pytest.mark.parametrize(
    "data",
    [
        b"",
        header(-1),
        header(5, -7),
        header(5)[:-3],
        b"\x00",
        b"\x15\x00\x1b" * 20,
        b"\x1c" * 100,
        b"\x15" + b"\xff" * 20,
    ],
)
def test_what_is_no_header_is_refused(data):
    with pytest.raises((ValueError, IndexError)):
        page_at(data)


def test_pages_that_leave_their_column_are_damage(tmp_path):
    written(tmp_path / "a.parquet")
    groups = row_groups(str(tmp_path / "a.parquet"))
    content = bytearray((tmp_path / "a.parquet").read_bytes())
    content[groups[0].chunks[0].start] = 0xFF
    (tmp_path / "a.parquet").write_bytes(content)
    with pytest.raises(LogError, match="is damaged: its pages do not fill their column"):
        check_pages(str(tmp_path / "a.parquet"), groups, {"t"})
    check_pages(str(tmp_path / "a.parquet"), groups, {"x"})  # what is not read is not looked at


def test_a_damaged_footer_is_told(tmp_path):
    """pyarrow ends the process when it is asked for a column of some of these."""
    written(tmp_path / "a.parquet")
    content = (tmp_path / "a.parquet").read_bytes()
    length = int.from_bytes(content[-8:-4], "little")
    (tmp_path / "a.parquet").write_bytes(content[: -8 - length] + b"\xff" * length + content[-8:])
    with pytest.raises(LogError, match="is damaged: its footer cannot be read"):
        row_groups(str(tmp_path / "a.parquet"))
