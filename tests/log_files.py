"""The same log as NPZ, HDF5, CSV or Parquet, written without the package."""

import numpy as np
import pytest

NAMES = {
    "wrench": ["fx", "fy", "fz", "tx", "ty", "tz"],
    "orientation": ["qx", "qy", "qz", "qw"],
    "position": ["x", "y", "z"],
    "angular_velocity": ["wx", "wy", "wz"],
}
SUFFIXES = [".npz", ".h5", ".csv", ".parquet"]


def columns(arrays):
    """Arrays by their names as columns of a table."""
    table = {}
    for name, values in arrays.items():
        if np.ndim(values) < 2:
            table[name] = values
        else:
            names = NAMES.get(name) or [f"{name}{i}" for i in range(len(values[0]))]
            table |= dict(zip(names, np.asarray(values).T, strict=True))
    return table


def write(path, arrays, **options):
    """Write arrays in the format of the suffix; ``options`` are those of the datasets of HDF5. Returns the path."""
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".h5":
        with pytest.importorskip("h5py").File(path, "w") as root:
            for name, values in arrays.items():
                root.create_dataset(name, data=values, **options)
    elif path.suffix == ".csv":
        table = columns(arrays)
        cells = [["" if x != x else repr(x) for x in np.asarray(values).tolist()] for values in table.values()]
        path.write_text("\n".join(",".join(row) for row in [list(table), *zip(*cells, strict=True)]) + "\n")
    else:
        arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        parquet.write_table(arrow.table(columns(arrays)), path)
    return path
