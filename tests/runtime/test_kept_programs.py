"""Programs that stay compiled between processes: loaded instead of traced, and compiled anew if loading fails."""

import os
from contextvars import Context

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.runtime import kept_programs
from ftbias_jax.runtime.kept_programs import ADDRESS, KeptProgram, compiled_for_few_calls, keep_program

X = np.arange(3.0, dtype=np.float32)


@pytest.fixture
def folder(tmp_path):
    """Replace the folder of JAX's cache temporarily."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def traced():
    """How often the function of ``program`` was traced."""
    return []


@pytest.fixture
def program(traced):
    """() -> a new program of one function, as another process would have it."""

    def new():
        def scaled(tree, *, factor=2.0):
            traced.append(factor)
            return {"scaled": factor * tree["x"]}

        return keep_program("factor")(scaled)

    return new


def test_what_one_process_compiled_another_one_does_not_trace(folder, program, traced):
    first = program()({"x": X})
    assert traced == [2.0]
    assert len(list(folder.rglob("*.program"))) == 1
    again = program()({"x": X})
    assert traced == [2.0]
    np.testing.assert_array_equal(again["scaled"], first["scaled"])
    np.testing.assert_array_equal(again["scaled"], 2 * X)


def _pipe(path):
    path.unlink()
    os.mkfifo(path)


def _sparse(path):
    os.truncate(path, 10 << 30)


def _swapped(path):
    """Replace the file by the one of the program that doubles five numbers."""
    path.write_bytes(next(other for other in path.parent.iterdir() if other != path).read_bytes())


@pytest.mark.parametrize("spoil", [_pipe, _sparse, _swapped, lambda path: path.write_bytes(b"no program")])
def test_a_file_that_is_no_such_program_is_not_there(folder, program, traced, spoil):
    program()({"x": X})
    (kept,) = folder.rglob("*.program")
    program()({"x": np.arange(5.0, dtype=np.float32)})
    spoil(kept)
    np.testing.assert_array_equal(program()({"x": X})["scaled"], 2 * X)
    assert len(traced) == 3


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_write_to_is_not_read(folder, program, traced, mode):
    program()({"x": X})
    (folder / "ftbias").chmod(mode)
    program()({"x": X})
    assert len(traced) == 2
    (folder / "ftbias").chmod(0o700)
    program()({"x": X})
    assert len(traced) == 2


def test_a_program_is_for_one_shape_one_precision_and_one_choice(folder, program, traced):
    one = program()
    one({"x": X})
    one({"x": X})
    assert len(traced) == 1
    np.testing.assert_array_equal(one({"x": X[:2]})["scaled"], 2 * X[:2])
    np.testing.assert_array_equal(one({"x": X}, factor=3.0)["scaled"], 3 * X)
    with jax.enable_x64(True):
        assert one({"x": X.astype(float)})["scaled"].dtype == np.float64
    assert traced == [2.0, 2.0, 3.0, 2.0]


def test_inside_another_program_it_is_a_part_of_that_one(folder, program):
    slope = jax.grad(lambda x: program()({"x": x})["scaled"].sum())(jnp.asarray(X))
    np.testing.assert_array_equal(slope, np.full(3, 2.0))
    assert not list(folder.rglob("*.program"))


def test_without_a_folder_nothing_is_kept(tmp_path, folder, program, traced):
    jax.config.update("jax_compilation_cache_dir", None)
    np.testing.assert_array_equal(program()({"x": X})["scaled"], 2 * X)
    program()({"x": X})
    assert len(traced) == 2
    assert not list(tmp_path.iterdir())


def test_what_only_its_place_in_memory_tells_from_others_is_not_kept(folder):
    choice = object()
    assert ADDRESS in repr(choice)
    one = KeptProgram(lambda x, choice: x + 1, ("choice",))
    np.testing.assert_array_equal(one(X, choice=choice), X + 1)
    assert not list(folder.rglob("*.program"))


def test_what_calls_lapack_is_not_kept(folder):
    one = KeptProgram(jnp.linalg.cholesky, ())
    np.testing.assert_allclose(one(4 * np.eye(2, dtype=np.float32)), 2 * np.eye(2))
    assert not list(folder.rglob("*.program"))


def test_what_does_not_compile_says_so_every_time(folder, program):
    one = program()
    for _ in range(2):
        with pytest.raises(KeyError):
            one({"y": X})


def test_prepared_programs_are_not_traced_when_they_are_called(folder, program, traced):
    one = program()
    one.prepare({"x": jax.ShapeDtypeStruct((3,), np.float32)})
    assert len(traced) == 1
    one({"x": X})
    assert len(traced) == 1


def test_a_program_that_fails_when_it_is_called_is_compiled(folder, program, traced, monkeypatch):
    program()({"x": X})

    def incomplete(*arguments):
        raise jax.errors.JaxRuntimeError("NOT_FOUND: Function")

    monkeypatch.setattr(kept_programs, "deserialize_and_load", lambda *parts: incomplete)
    again = program()
    for _ in range(2):
        np.testing.assert_array_equal(again({"x": X})["scaled"], 2 * X)
    assert len(traced) == 2


def test_a_program_for_few_calls_is_one_of_its_own_with_the_same_numbers(folder, program):
    one = program()
    for _ in range(2):
        with compiled_for_few_calls():
            few = one({"x": X})["scaled"]
    np.testing.assert_array_equal(Context().run(one, {"x": X})["scaled"], few)
    assert len(list(folder.rglob("*.program"))) == 2


def test_a_program_for_many_calls_that_is_there_serves_few_calls_as_well(folder, program):
    one = program()
    usual = Context().run(one, {"x": X})
    with compiled_for_few_calls():
        np.testing.assert_array_equal(one({"x": X})["scaled"], usual["scaled"])
    assert len(list(folder.rglob("*.program"))) == 1
