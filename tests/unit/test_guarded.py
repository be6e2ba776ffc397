"""Files whose libraries can run code, hang or crash: what a child process reads, and what it refuses."""

from __future__ import annotations

import os
import pickle
import time
from collections import OrderedDict, defaultdict
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from detection_files import deeplabcut_table
from skelsplat import io
from skelsplat.io import _guarded
from skelsplat.io._arrays import load_npy, load_npz
from skelsplat.io._guarded import read_guarded, unpickle

STRUCTURED = np.dtype([("R", np.float32, (3, 3)), ("name", "U5"), ("row", ">i4")])
VALUES = {
    "transposed": np.arange(6.0).reshape(2, 3).T,
    "structured": np.array([(np.eye(3), "abc", 7)] * 2, dtype=STRUCTURED),
    "objects": np.array([{"x": 1}, None], dtype=object),
    "big_endian": np.arange(5, dtype=">f4"),
    "empty": np.zeros((0, 3)),
    "text": np.array(["a", "bcd"]),
    "number": np.float32(3),
    "string": np.str_("ab"),
    "flag": np.bool_(True),
    "bytes": b"xyz",
    "numbers": (1, 2.5, 3j, True, None, 2**80),
    "set": {1, 2},
    "ordered": OrderedDict(b=1),
    "table": {("a", 1): [np.nan], 2: {"b": "é\ud800"}},
}


def saved(folder: Path, content: bytes) -> Path:
    path = folder / "x.pkl"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_data_come_back_as_pickle_reads_them(tmp_path, protocol):
    data = pickle.dumps(VALUES, protocol=protocol)
    expected, got = pickle.loads(data), unpickle(saved(tmp_path, data))
    assert got.pop("ordered") == dict(expected.pop("ordered"))
    assert repr(got) == repr(expected)
    assert got["structured"].dtype == STRUCTURED
    assert got["transposed"].flags.f_contiguous == expected["transposed"].flags.f_contiguous


def test_numpy_2_and_numpy_1_call_their_core_differently(tmp_path):
    data = pickle.dumps(np.arange(3), protocol=0)
    for old, new in ((b"numpy._core.", b"numpy.core."), (b"numpy.core.", b"numpy._core.")):
        assert unpickle(saved(tmp_path, data.replace(old, new))).tolist() == [0, 1, 2]


def test_python_2_wrote_arrays_as_text(tmp_path):
    """What Python 2 with protocol 0 gives for np.arange(2, dtype='<i2') and a long."""
    data = (
        b"(dp0\nS'a'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4\nS'b'\np5\n"
        b"tp6\nRp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'i2'\np10\nI0\nI1\ntp11\nRp12\n(I3\nS'<'\np13\nNNNI-1\n"
        b"I-1\nI0\ntp14\nbI00\nS'\\x00\\x00\\x01\\x00'\np15\ntp16\nbsS'n'\np17\nL5L\ns."
    )
    got = unpickle(saved(tmp_path, data))
    assert (got["n"], got["a"].tolist()) == (5, [0, 1])


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


@pytest.mark.parametrize("name", ["x.pkl", "x.npy", "x.npz", "x.h5"])
def test_nothing_is_run(tmp_path, name):
    path, made = tmp_path / name, tmp_path / "made"
    if name == "x.h5":  # PyTables opens pickled attributes
        pytest.importorskip("tables")
        deeplabcut_table(np.ones((2, 1, 1, 3)), ["nose"], 0, multi=False).to_hdf(path, key="df_with_missing")
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "a") as file:
            file["df_with_missing"].attrs["evil"] = np.bytes_(pickle.dumps(Bomb(made), 0))
        path = path.rename(tmp_path / "camDLC_x.h5")
    elif name == "x.pkl":
        path.write_bytes(pickle.dumps([Bomb(made)]))
    else:
        save = np.save if name == "x.npy" else np.savez
        save(path, np.array([Bomb(made)], dtype=object), allow_pickle=True)
    read = {"x.pkl": unpickle, "x.npy": load_npy, "x.npz": lambda path: load_npz(path, ["arr_0"])}.get(
        name, lambda _: io.read_detections(tmp_path, ["cam"], layout="h36m17")
    )
    with pytest.raises(sk.DatasetError):
        read(path)
    assert not made.exists()


def bomb(depth: int) -> object:
    value: list[object] = [1.0]
    for _ in range(depth):
        value = [value, value]
    return value


def again(call: bytes, times: int) -> bytes:
    """Pickle a list of results of the same call, on the same argument: a text of 10^5 letters."""
    text = pickle.dumps("a" * 10**5, protocol=2)[2:-1]
    return b"\x80\x02" + text[:-2] + b"q\x010]" + b"(" + (call + b"h\x01\x85R") * times + b"e."


def flagged_dtype() -> bytes:
    """Pickle an array whose dtype says by its flags that 16 bytes are addresses of objects."""
    return (
        b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR(I1\n(I2\ntcnumpy\ndtype\n(S'f8'\n"
        b"I0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI63\ntbI00\nS'" + b"A" * 16 + b"'\ntb."
    )


PICKLES = {
    "a function": pickle.dumps(os.system),
    "a class": pickle.dumps(Path("x")),
    "a table with a default": pickle.dumps(defaultdict(list)),
    "lists": pickle.dumps(bomb(30)),
    "deep": b"]" * 10**5 + b"a" * (10**5 - 1) + b".",
    "bytes": b"\x80\x02B\xff\xff\xff\x7fabc.",
    "copies": again(b"c_codecs\nencode\n", 10_000),
    "cut": pickle.dumps(np.arange(99))[:-50],
}


@pytest.mark.parametrize("case", PICKLES)
def test_a_damaged_or_hostile_pickle_is_an_error_at_once(tmp_path, case):
    unpickle(saved(tmp_path, pickle.dumps(1)))  # so that the child is there
    path, start = saved(tmp_path, PICKLES[case]), time.process_time()
    with pytest.raises(sk.DatasetError) as caught:
        unpickle(path)
    assert (caught.value.path, caught.value.field) == (path, "pickle")
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < 1.0
    assert unpickle(saved(tmp_path, pickle.dumps([2]))) == [2]  # by the same child, or by another


def test_flags_of_a_dtype_are_not_believed(tmp_path):
    assert unpickle(saved(tmp_path, flagged_dtype())).dtype == np.float64


def test_arrays_of_objects_come_from_npy_and_npz(tmp_path):
    table = np.array({"S9": [np.ones((2, 3))]}, dtype=object)
    np.save(tmp_path / "a.npy", table)
    np.savez(tmp_path / "a.npz", table=table, plain=np.arange(3))
    found = load_npz(tmp_path / "a.npz", ["table", "plain"]).found
    for got in (load_npy(tmp_path / "a.npy"), found["table"]):
        assert got.item()["S9"][0].shape == (2, 3)
    assert found["plain"].tolist() == [0, 1, 2]


def test_a_mat_file_has_cells_structures_and_texts(tmp_path):
    scipy = pytest.importorskip("scipy.io")
    cells = np.empty((1, 2), object)
    cells[0] = [{"K": np.eye(3), "name": "é"}, np.arange(4.0)]
    scipy.savemat(tmp_path / "a.mat", {"params": cells, "t": [[1, 2]]})
    found, expected = (
        read_guarded("mat", tmp_path / "a.mat", "cells", names=None),
        scipy.loadmat(tmp_path / "a.mat"),
    )
    assert found["params"].dtype == expected["params"].dtype
    assert repr(found["params"]) == repr(expected["params"])
    assert list(read_guarded("mat", tmp_path / "a.mat", "cells", names=["t"])) == ["t"]


def test_hdf5_of_more_than_the_memory_and_of_other_files_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "d.h5"
    makes = [
        lambda file: file.create_dataset("tracks", (1, 2, 17, 10**9), "f4", chunks=True, compression="gzip"),
        lambda file: file.__setitem__("tracks", h5py.ExternalLink("/dev/zero", "/x")),
        lambda file: file.create_dataset("tracks", (9,), "f8", external=[("/dev/zero", 0, 72)]),
        lambda file: file.create_group("tracks"),
    ]
    for make in makes:
        with h5py.File(path, "w") as file:
            make(file)
        with pytest.raises(sk.DatasetError) as caught:
            io.read_detections(tmp_path, ["d"], layout="coco17", format="sleap")
        assert caught.value.path == path


ENDS = {
    "os.kill(os.getpid(), signal.SIGSEGV)": "signal 11",
    "os.abort()": "signal 6",
    "exec('while True: pass')": "signal",
    "bytearray(10**9)": "memory",
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits and signals of a POSIX system")
@pytest.mark.parametrize("reading", ENDS)
def test_a_file_that_ends_its_reader_is_an_error(tmp_path, monkeypatch, reading):
    (tmp_path / "ezc3d.py").write_text(f"import os, signal\ndef c3d(_): {reading}\n")
    monkeypatch.syspath_prepend(tmp_path)
    _guarded._end()
    (tmp_path / "pose.c3d").write_bytes(b"x")
    with pytest.raises(
        sk.DatasetError, match=rf"pose\.c3d: file: expected a complete C3D file, got .*{ENDS[reading]}"
    ):
        io.read_c3d(tmp_path / "pose.c3d")
    _guarded._end()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_a_fork_has_a_child_of_its_own(tmp_path):
    path = saved(tmp_path, pickle.dumps([1]))
    assert unpickle(path) == [1]
    pid = os.fork()
    if pid == 0:
        os._exit(0 if unpickle(path) == [1] else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert unpickle(path) == [1]


def test_the_child_imports_nothing_from_where_it_is_called(tmp_path, monkeypatch):
    for name in ("numpy.py", "pickle.py", "json.py"):
        (tmp_path / name).write_text("raise SystemExit('of the folder')")
    monkeypatch.chdir(tmp_path)
    _guarded._end()
    assert unpickle(saved(tmp_path, pickle.dumps([1]))) == [1]
