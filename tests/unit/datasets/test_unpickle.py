"""The restricted unpickler: what it reads, and that it runs nothing."""

from __future__ import annotations

import io
import os
import pickle
from collections import OrderedDict, defaultdict
from pathlib import Path

import numpy as np
import pytest

from skelsplat import DatasetError
from skelsplat.datasets._files import load_npy, load_npz, load_pickle
from skelsplat.datasets._unpickle import unpickle

PATH = Path("some.pkl")
STRUCTURED = np.dtype([("R", np.float32, (3, 3)), ("name", "U5"), ("row", ">i4")])
VALUES = {
    "transposed": np.arange(6.0).reshape(2, 3).T,
    "structured": np.array([(np.eye(3), "abc", 7)] * 2, dtype=STRUCTURED),
    "objects": np.array([{"x": 1}, None], dtype=object),
    "big_endian": np.arange(5, dtype=">f4"),
    "empty": np.zeros((0, 3)),
    "text": np.array(["a", "bcd"]),
    "scalar": np.float32(3),
    "string": np.str_("ab"),
    "flag": np.bool_(True),
    "bytes": b"xyz",
    "nothing": b"",
    "bytearray": bytearray(b"q"),
    "numbers": (1, 2.5, 3j, True, None, 2**80),
    "set": {1, 2},
    "ordered": OrderedDict(a=1),
}


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def load(data: bytes) -> object:
    return unpickle(io.BytesIO(data), PATH)


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("name", VALUES)
def test_data_come_back_as_pickle_reads_them(name, protocol):
    data = pickle.dumps(VALUES[name], protocol=protocol)
    expected, got = pickle.loads(data), load(data)
    if not isinstance(expected, np.ndarray):
        assert got == expected
        assert type(got) is type(expected)
        return
    assert got.dtype == expected.dtype
    assert got.shape == expected.shape
    assert repr(np.asarray(got)) == repr(expected)


def test_numpy_2_and_numpy_1_call_their_core_differently():
    data = pickle.dumps(np.arange(3), protocol=0)
    new = data.replace(b"numpy.core.", b"numpy._core.")
    old = data.replace(b"numpy._core.", b"numpy.core.")
    assert new != old
    for variant in (new, old):
        np.testing.assert_array_equal(load(variant), np.arange(3))


def test_python_2_wrote_arrays_as_text():
    """What Python 2 with protocol 0 gives for np.arange(2, dtype='<i2') and a long."""
    data = (
        b"(dp0\nS'a'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4\nS'b'\np5\n"
        b"tp6\nRp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'i2'\np10\nI0\nI1\ntp11\nRp12\n(I3\nS'<'\np13\nNNNI-1\n"
        b"I-1\nI0\ntp14\nbI00\nS'\\x00\\x00\\x01\\x00'\np15\ntp16\nbsS'n'\np17\nL5L\ns."
    )
    got = load(data)
    assert got["n"] == 5
    np.testing.assert_array_equal(got["a"], [0, 1])


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (os.system, "system"),
        (eval, "eval"),
        (getattr, "getattr"),
        (np.load, "load"),
        (np.memmap, "memmap"),
        (pickle.loads, "loads"),
        (Path("x"), "pathlib"),
        (defaultdict(list), "defaultdict"),
    ],
)
def test_anything_else_is_refused_by_name(value, name):
    with pytest.raises(DatasetError, match=rf"some\.pkl: pickle: expected NumPy arrays.*{name}"):
        load(pickle.dumps(value))


@pytest.mark.parametrize("kind", ["pkl", "npy", "npz"])
def test_what_is_forbidden_does_not_run(tmp_path, kind):
    made = tmp_path / "made"
    bomb = np.array({"table": Bomb(made)}, dtype=object)
    path = tmp_path / f"data.{kind}"
    if kind == "pkl":
        path.write_bytes(pickle.dumps(bomb))
    elif kind == "npy":
        np.save(path, bomb, allow_pickle=True)
    else:
        np.savez(path, positions=bomb)
    with pytest.raises(DatasetError, match=r"(posix|nt)\.mkdir") as caught:
        {"pkl": load_pickle, "npy": load_npy, "npz": load_npz}[kind](path)
    assert caught.value.path == path
    assert caught.value.field == {"pkl": "pickle", "npy": "array", "npz": "positions"}[kind]
    assert not made.exists()
    # The same bytes do run where they are trusted.
    if kind == "pkl":
        pickle.loads(path.read_bytes())
        assert made.is_dir()


def test_a_refused_module_is_not_even_imported(tmp_path, monkeypatch):
    (tmp_path / "evil_module.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DatasetError, match=r"evil_module\.thing"):
        load(b"cevil_module\nthing\n.")


def _array_state(dtype: bytes, raw: bytes) -> bytes:
    """Return a pickle of an array of shape (1,), its dtype and bytes given as opcodes."""
    start = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR"
    return start + b"(I1\n(I1\nt" + dtype + b"I00\n" + raw + b"tb."


@pytest.mark.parametrize(
    "data",
    [
        # A structure with an object in it whose flags deny it: NumPy would take the bytes for a pointer.
        _array_state(
            b"cnumpy\ndtype\n(S'V8'\nI0\nI1\ntR(I3\nS'|'\nN(S'a'\nt(dS'a'\n(cnumpy\ndtype\n(S'O'\nI0\nI1\ntRI0\ntsI8\n"
            b"I1\nI0\ntb",
            b"S'AAAAAAAA'\n",
        ),
        _array_state(b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR", b"S'AAAA'\n"),  # too few bytes
        _array_state(b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR", b"I99999\n"),  # a number in place of bytes
        _array_state(b"cnumpy\ndtype\n(S'O'\nI0\nI1\ntR", b"S'AAAAAAAA'\n"),  # bytes in place of objects
        _array_state(b"cnumpy\ndtype\n(S'M8'\nI0\nI1\ntR", b"S'AAAAAAAA'\n"),  # a dtype nobody needs
        b"cnumpy\nndarray\n(I4\ntR.",  # the class itself called
        b"c__builtin__\nbytes\n(I99999\ntR.",  # memory by number
        b"c_codecs\nencode\n(S'aaaa'\nS'utf-16'\ntR.",
        b"c_codecs\nencode\n(dS'x'\nI1\nsb.",  # a state for a function
        b"P0\n.",  # a persistent reference
        b"N",  # no end
        b"",
        b"\x80\x63.",
    ],
)
def test_a_pickle_that_lies_is_refused(data):
    with pytest.raises(DatasetError, match=r"some\.pkl: pickle: expected"):
        load(data)


def test_every_truncation_is_refused():
    data = pickle.dumps({"a": np.arange(4.0), "b": [1, "x"]})
    for length in range(len(data)):
        with pytest.raises(DatasetError):
            load(data[:length])


@pytest.mark.parametrize("array", [np.arange(12.0).reshape(3, 4), np.array({"a": 1}, dtype=object)])
@pytest.mark.parametrize("kind", ["npy", "npz"])
def test_a_file_cut_anywhere_is_refused(tmp_path, array, kind):
    path = tmp_path / f"data.{kind}"
    if kind == "npy":
        np.save(path, array, allow_pickle=True)
    else:
        np.savez_compressed(path, key=array)
    whole = path.read_bytes()
    read = load_npy if kind == "npy" else load_npz
    read(path)
    for length in range(0, len(whole) - 1, 7):
        path.write_bytes(whole[:length])
        with pytest.raises(DatasetError) as caught:
            read(path)
        assert caught.value.path == path


def test_a_damaged_npz_is_refused(tmp_path):
    """One bit in the data of a member: the archive's checksum tells."""
    path = tmp_path / "data.npz"
    np.savez(path, key=np.arange(1000.0))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DatasetError, match="npz"):
        load_npz(path)


@pytest.mark.parametrize(
    "array", [np.asfortranarray(np.arange(6).reshape(2, 3)), np.float64(3.0), np.zeros((0, 2))]
)
def test_plain_arrays_come_back(tmp_path, array):
    path = tmp_path / "a.npy"
    np.save(path, array)
    got = load_npy(path)
    np.testing.assert_array_equal(got, array)
    assert np.shape(got) == np.shape(array)
