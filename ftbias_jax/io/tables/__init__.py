"""Logs as tables and named arrays: NPZ, CSV, Parquet and HDF5."""
