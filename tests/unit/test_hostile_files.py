"""Files that claim, nest or repeat more than they hold are refused in one line, at once, in little memory."""

from __future__ import annotations

import io as streams
import os
import pickle
import re
import resource
import socket
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import _budget, io
from skelsplat.io._files import csv_lines, load_json, natural
from skelsplat.io._unpickle import unpickle
from skelsplat.io.poses import convert_poses

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="limits of memory, pipes and devices of Linux"
)
_MORE = 400 * 2**20  # bytes that a refusal may take


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + _MORE, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


def calibration(path: Path) -> object:
    return io.read_calibration(path, unit="mm")


def detections(path: Path) -> object:
    return io.read_detections(path, ["cam0", "cam1"], layout="coco17", order="sorted")


def refused(read: Callable[[Path], object], path: Path, text: str) -> None:
    with pytest.raises(sk.DatasetError, match=text) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def npy(shape: object, kind: str = "<f8", data: bytes = b"") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + data


DEEP = "[" * 960 + "]" * 960
TEXTS: dict[str, tuple[str, str, Callable[[Path], object], str]] = {
    "a word in YAML": (
        "intri.yml",
        "%YAML:1.0\nK_a: !!opencv-matrix\n   " + "a" * 200_000,
        calibration,
        "K_a: expected a matrix with rows, cols and data, got no rows, cols, data",
    ),
    "blanks in YAML": ("intri.yml", "%YAML:1.0\na" + " " * 10**6 + "b", calibration, "expected key: value"),
    "digits in YAML": ("intri.yml", f"%YAML:1.0\na: {'1' * 200_000}x", calibration, "keys: expected K_NAME"),
    "blank lines": ("c.toml", "\n" * 200_000 + "x", calibration, "content: expected"),
    "JSON 960 deep": (
        "c.json",
        f'{{"format": "skelsplat-calibration", "version": 1, "cameras": {DEEP}}}',
        calibration,
        r"JSON: expected a calibration, got lists nested too deeply \(at most 64 deep\)",
    ),
    "JSON 10^6 deep": ("c.json", "[" * 10**6, calibration, "nested too deeply"),
    "half a character": ("p.json", r'{"joint_names": ["\ud800"]}', io.read_pose, "texts in Unicode"),
    "a key of many parts": ("c.toml", "a" + ".a" * 10**5 + " = 1", calibration, "keys of at most 32 parts"),
    "a key alone": ("c.toml", "[a]\n" + "a." * 10**5, calibration, "keys of at most 32 parts"),
    "quoted keys": ("c.toml", '"=\\"".a.' * 10**4, calibration, "keys of at most 32 parts"),
    "a long TOML": (
        "c.toml",
        "a = 1\n" * 400_000,
        calibration,
        "at most 2,097,152 characters, got 2,400,000",
    ),
    "TOML nested": ("c.toml", f"a = {'[' * 70}{']' * 70}", calibration, "nested at most 64 deep"),
    "XML entities": ("c.xml", "<!DOCTYPE a><a/>", calibration, "a document without a DOCTYPE"),
    "XML nested": ("c.xml", "<a>" * 1000 + "</a>" * 1000, calibration, "elements nested at most 64 deep"),
    "many columns": (
        "d.csv",
        "frame,joint,x,y" + ",1" * 10**6,
        detections,
        "at most 65536 fields, got 1000004",
    ),
    "a long line": ("d.csv", "frame,joint,x,y\n" + "1" * 5_000_000, detections, "line 2: .* 4,194,304 char"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_text_is_read_in_time_proportional_to_its_length(tmp_path: Path, case: str) -> None:
    name, text, read, message = TEXTS[case]
    path = tmp_path / name
    path.write_text(text)
    refused(read, path, message)


def test_dots_in_numbers_and_texts_are_no_parts_of_a_key(tmp_path: Path) -> None:
    numbers = ", ".join(["0.5"] * 1000)
    text = f"a = [{numbers}]\nb = '{'x. ' * 100}' # {'.' * 99}\nc = \"{'.' * 99}\"\nd.e.f = 1\n"
    assert _budget.parse_toml(tmp_path, text)["a"] == [0.5] * 1000


def test_values_of_json_beyond_the_memory_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_budget, "_available", lambda: 10**8)
    path = tmp_path / "c.json"
    path.write_text("[" + "[]," * 10**6 + "[]]")
    refused(
        calibration, path, r"JSON: expected what fits into memory \(100.0 MB are available\), got .* 108.0 MB"
    )


def test_brackets_in_strings_do_not_nest(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text(r'["\"' + "[{" * 100 + r'\\", ["]"], ' + '"[" , ' * 100 + '"\u0130"]')
    assert load_json(path, "x")[1] == ["]"]


def bound(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


@pytest.mark.parametrize(
    "name", ["c.json", "intri.yml", "d.csv", "p.trc", "p.npz", "p.csv", "d.npy", "d.h5", "x.mat"]
)
def test_what_is_no_file_is_not_opened(tmp_path: Path, name: str) -> None:
    read = io.read_pose if name[0] == "p" else calibration if name[0] in "cix" else detections
    path = tmp_path / name
    for make, kind in (
        (os.mkfifo, "a named pipe"),
        (lambda p: p.symlink_to("/dev/zero"), "a device"),
        (bound, "a socket"),
        (lambda p: p.symlink_to(p.name), "too many levels of symbolic links"),
    ):
        make(path)
        with pytest.raises(sk.DatasetError) as caught:
            read(path)
        assert kind in str(caught.value)
        path.unlink()


def test_a_sparse_file_is_refused(tmp_path: Path) -> None:
    for name, start in (("d.npy", npy((2, 10**8, 25, 2))), ("p.json", b"{"), ("p.npz", b"PK\3\4")):
        path = tmp_path / name
        path.write_bytes(start)
        os.truncate(path, 80 * 10**9)
        if path.stat().st_blocks > 1000:
            pytest.skip("a file system without sparse files")
        read = detections if name[0] == "d" else io.read_pose
        with pytest.raises(sk.DatasetError, match=r"a sparse file: 80\.0 GB|content: expected detections"):
            read(path)


def test_a_file_larger_than_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_budget, "_available", lambda: 2**27)
    path = tmp_path / "p.json"
    path.write_bytes(b" " * 7 * 10**7)
    refused(
        io.read_pose,
        path,
        r"file: expected what fits into memory \(134.2 MB are available\), got .* 140.0 MB",
    )


def bomb(depth: int, kind: type = list) -> Any:
    value: Any = kind([1.0])
    for _ in range(depth):
        value = kind([value, value])
    return value


def again(call: bytes, times: int) -> bytes:
    """Pickle a list of results of the same call, on the same argument: a text of 10^5 letters."""
    text = pickle.dumps("a" * 10**5, protocol=2)[2:-1]
    return b"\x80\x02" + text[:-2] + b"q\x010]" + b"(" + (call + b"h\x01\x85R") * times + b"e."


PICKLES = {
    "lists": (pickle.dumps(bomb(30)), "by naming the same ones again"),
    "tables": (pickle.dumps({"a": bomb(30, tuple)}), "by naming the same ones again"),
    "itself": (b"\x80\x02]q\x00h\x00a.", "nested at most 64 deep"),
    "deep": (b"]" * 10**5 + b"a" * (10**5 - 1) + b".", "nested at most 64 deep"),
    "a memo": (b"\x80\x02]r\xff\xff\xff\x7f.", "kept under a number above"),
    "a memo in text": (b"]p2000000000\n.", "kept under"),
    "bytes": (b"\x80\x02B\xff\xff\xff\x7fabc.", "a complete pickle"),
    "text of a list": (b"\x80\x02c__builtin__\nstr\n]\x85R.", "a str of something else"),
    "copies": (again(b"c_codecs\nencode\n", 10_000), "by naming the same bytes again"),
}


@pytest.mark.parametrize("case", PICKLES)
def test_a_pickle_has_no_more_in_it_than_its_bytes(tmp_path: Path, case: str) -> None:
    content, message = PICKLES[case]
    refused(lambda path: unpickle(streams.BytesIO(content), path), tmp_path / "x.pkl", message)
    path = tmp_path / "x.npy"
    path.write_bytes(npy((), "|O", content))
    refused(sk.io._arrays.load_npy, path, "array: expected ")


def test_a_pickle_that_shares_what_is_in_it_is_read() -> None:
    camera = {"R": np.eye(3), "name": "a"}
    value = [{"camera": camera, "joints": np.full((17, 2), k), "set": {1, 2}} for k in range(100)]
    for protocol in range(6):
        found = unpickle(streams.BytesIO(pickle.dumps(value, protocol)), Path("x.pkl"))
        assert found[99]["camera"] is found[0]["camera"]
        assert (found[99]["joints"] == 99).all()


def zipped(path: Path, member: bytes, name: str = "pose.npy", **claims: int) -> Path:
    """Write a zip file of one member; then change what its list of members claims."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, member)
    content = bytearray(path.read_bytes())
    at = content.rfind(b"PK\1\2")
    for field, value in claims.items():
        struct.pack_into("<I", content, at + {"unpacked": 24}[field], value)
    path.write_bytes(content)
    return path


def test_a_zip_file_does_not_unpack_to_gigabytes(tmp_path: Path) -> None:
    path = zipped(tmp_path / "pose.npz", npy((10**6, 17, 3)), unpacked=4 * 10**9)
    message = r"file: expected at most 134.2 MB from \d+ bytes \(or a file without packing\), got 4.0 GB"
    for read in (io.read_pose, detections, calibration):
        with (
            suppress(sk.InvalidInputError),
            pytest.raises(sk.DatasetError, match=f"{message}|content: expected"),
        ):
            read(path)
    refused(io.read_pose, path, message)
    long = bytearray(path.read_bytes())
    struct.pack_into("<I", long, long.rfind(b"PK\5\6") + 12, 10**9)
    path.write_bytes(long)
    refused(io.read_pose, path, "a list of its members of at most 262.1 kB, got 1.0 GB")


def test_a_zip_file_of_thousands_of_members_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "pose.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(8000):
            archive.writestr(f"{number}.npy", b"")
    message = "a list of its members of at most 262.1 kB, got 430.9 kB"
    for read in (io.read_pose, detections, calibration):
        refused(read, path, f"{message}|content: expected")
    refused(io.read_pose, path, message)


NPY = {
    "claims 80 GB": (npy((2, 10**8, 25, 2)), r"expected 80000000000 bytes .*, got \d+, cut short"),
    "negative": (npy((-2, 3, 17, 2)), "a shape with the length -2"),
    "no numbers": (npy((10**15, 0, 17, 2)), "1000000000000000 rows of nothing"),
    "of nothing": (npy((10**15, 3, 17, 2), "|V0"), "numbers or texts, got the type"),
    "axes": (npy((1,) * 100, data=bytes(8)), "an array in npy format"),
    "brackets": (npy("(" * 60 + ")"), "an array in npy format"),
    "a version": (b"\x93NUMPY\x09\x00" + bytes(99), "version"),
}


@pytest.mark.parametrize("case", NPY)
def test_a_header_of_npy_claims_what_is_there(tmp_path: Path, case: str) -> None:
    content, message = NPY[case]
    path = tmp_path / "x.npy"
    path.write_bytes(content)
    refused(sk.io._arrays.load_npy, path, message)
    refused(io.read_pose, zipped(tmp_path / "x.npz", content), message)


def test_no_damage_of_an_npy_header_is_a_traceback(tmp_path: Path) -> None:
    whole = npy((2, 3), data=bytes(48))
    path = tmp_path / "x.npy"
    refusals = 0
    for bit in range(8 * 80)[::3]:
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            sk.io._arrays.load_npy(path)
        except sk.DatasetError:
            refusals += 1
    assert refusals > 150


def test_numbers_in_names_have_any_length() -> None:
    names = ["cam²", "cam10", "cam2", "cam" + "1" * 5000, "cam002"]
    assert sorted(names, key=natural) == ["cam2", "cam002", "cam10", names[3], "cam²"]


def test_a_table_is_read_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes('\ufeffa,b\r\n1,"2\n3"\r4,5'.encode())
    lines = csv_lines(path)
    assert next(lines) == ["a", "b"]
    assert list(lines) == [["1", "2\n3"], ["4", "5"]]
    path.write_bytes(b"a,b\n" * 5000 + b"\xff")
    refused(lambda p: list(csv_lines(p)), path, "text in UTF-8, got byte 0xff at 20000, which is not")


def hdf5(path: Path, **datasets: tuple[tuple[int, ...], object]) -> Any:
    h5py = pytest.importorskip("h5py")
    file = h5py.File(path, "w")
    for name, (shape, kind) in datasets.items():
        file.create_dataset(name, shape, kind, chunks=True, compression="gzip")
    return file


def sleap(path: Path) -> object:
    return io.read_detections(path, ["d"], layout="coco17", format="sleap")


def test_hdf5_claims_no_more_than_it_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "d" / "d.h5"
    path.parent.mkdir()
    hdf5(path, tracks=((1, 2, 17, 10**9), "f4")).close()
    refused(
        lambda p: sleap(p.parent), path, r"tracks: expected at most 13\d\.\d MB from .* kB .*, got 136.0 GB"
    )
    path = tmp_path / "pose.nc"
    hdf5(path, position=((10**9, 3, 17, 1), "f8")).close()
    refused(io.read_pose, path, "position: expected at most .* got 408.0 GB")


def test_hdf5_leads_to_no_other_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "pose.nc"
    layout = h5py.VirtualLayout((2,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (2,))
    makes = {
        "position: expected data in this file, got a link": lambda file: file.__setitem__(
            "position", h5py.ExternalLink("/dev/zero", "/x")
        ),
        "position: expected data in this file, got those": lambda file: file.create_virtual_dataset(
            "position", layout
        ),
        "x: expected data in this file, got those": lambda file: file.create_dataset(
            "x", (9,), "f8", external=[("/dev/zero", 0, 72)]
        ),
        "at most 10000 groups": lambda file: [file.create_group(str(k)) for k in range(10_001)],
    }
    for message, make in makes.items():
        with hdf5(path) as file:
            make(file)
        refused(io.read_pose, path, message)


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(shape: tuple[int, ...], *inner: bytes, kind: int = 1) -> bytes:
    lengths = element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(
        14, element(6, struct.pack("<II", kind, 0)) + lengths + element(1, b"params") + b"".join(inner)
    )


def nested(depth: int) -> bytes:
    inner = matrix((1, 1), element(9, bytes(8)), kind=6)
    for _ in range(depth):
        inner = matrix((1, 1), inner)
    return inner


def packed(*parts: bytes) -> bytes:
    data = zlib.compress(b"".join(parts), 9)
    return struct.pack("<II", 15, len(data)) + data


MATS = {
    "unpacks": (packed(matrix((1, 1), bytes(150_000_000))), r"file: expected at most 1\d\d\.\d MB from"),
    "claims": (matrix((2**30, 2)), "a matrix of at most a value per byte, got one of 1073741824×2"),
    "claims within": (packed(matrix((1, 1), matrix((2**20, 2**10)))), "got one of 1048576×1024"),
    "deep": (nested(70), "cells nested at most 64 deep"),
    # SciPy takes these types for addresses
    "of no numbers": (matrix((1, 1), element(0, bytes(8)), kind=6), "got a damaged one"),
    "of far numbers": (packed(matrix((1, 1), matrix((1, 1), element(255, bytes(8)), kind=6))), "damaged one"),
    "of no lengths": (matrix((1,), element(9, bytes(8)), kind=6), "got a damaged one"),
    "too few cells": (matrix((1, 2), matrix((1, 1), element(9, bytes(8)), kind=6)), "got a damaged one"),
    "without fields": (matrix((1, 1), element(5, b"\2\0\0\0"), element(1, b"a\0b\0"), kind=2), "damaged one"),
    "cut": (matrix((1, 1), element(9, bytes(8)), kind=6)[:-8], "got a damaged one"),
}


@pytest.mark.parametrize("case", MATS)
def test_a_mat_file_has_no_more_in_it_than_its_bytes(tmp_path: Path, case: str) -> None:
    pytest.importorskip("scipy")
    content, message = MATS[case]
    path = tmp_path / "x.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + content)
    refused(calibration, path, message)


POSES = {"pose": np.ones((1, 2, 3)), "joint_names": ["a", "b"], "frames": [5], "unit": "mm"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": [5.5]}, "frames: expected whole numbers, got 5.5"),
        ({"pose": np.full((1, 2, 3), np.inf)}, "pose: expected finite numbers, none for what is missing"),
        ({"pose": np.full((1, 2, 3), 1e300)}, r"pose: expected numbers within ±1e\+33, got 1e\+300"),
        ({"joint_bias": np.full((1, 2), 1e300)}, r"joint_bias: expected numbers within ±1e\+33"),
        ({"uncertainty": np.full((1, 2, 3, 3), 1e70)}, r"uncertainty: expected numbers within ±1e\+66"),
        ({"uncertainty": np.full((1, 2, 3, 3), np.inf)}, "uncertainty: expected finite numbers"),
        ({"joint_names": np.array([b"a", b"a"])}, "joint_names: expected different names, got 'a' twice"),
        ({"joint_names": np.array([7, 8])}, "joint_names: expected 2 names, got int64"),
        ({"joint_names": np.array(["\ud800", "b"])}, "joint_names: expected texts in Unicode"),
        (
            {"joint_names": ["a" * 300, "b"]},
            "joint_names: expected names of at most 255 bytes, got one of 300",
        ),
    ],
)
def test_poses_that_no_writer_could_write_are_not_read(tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "pose.npz"
    np.savez(path, **{**POSES, **change})
    refused(io.read_pose, path, message)


def test_names_of_bytes_are_texts(tmp_path: Path) -> None:
    path = tmp_path / "pose.npz"
    np.savez(path, **{**POSES, "joint_names": np.array([b"a", "\u00e9".encode()])})
    assert convert_poses(path, tmp_path / "p.trc", fps=50).joint_names == ("a", "\u00e9")


TRC = "PathFileType\t4\nDataRate\n9\t9\t1\t1\tmm\t9\t1\t1\nFrame#\tTime\ta\t\t\n\tX1\n\n1\t0\t{}\t1\t1\n"


def test_an_infinite_coordinate_is_refused_in_text(tmp_path: Path) -> None:
    for name, text in {"p.csv": "frame,joint,x,y,z,unit\n0,a,{},1,1,mm\n", "p.trc": TRC}.items():
        for number in ("inf", "-1e999"):
            (tmp_path / name).write_text(text.format(number))
            refused(io.read_pose, tmp_path / name, "pose: expected finite numbers")


@pytest.mark.parametrize("kind", ["json", "c3d", "nc"])
def test_an_infinite_coordinate_is_refused(tmp_path: Path, kind: str) -> None:
    pytest.importorskip({"json": "json", "c3d": "ezc3d", "nc": "h5netcdf"}[kind])
    path = tmp_path / f"p.{kind}"
    io.write_pose(path, io.PoseData(np.full((2, 1, 3), 7.5), ("a",), np.arange(2), "mm", frame_rate=9.0))
    content = path.read_bytes()
    for there, infinite in (
        (b"[[7.5", b"[[1e999"),
        (np.float32([7.5]).tobytes(), np.float32([np.inf]).tobytes()),
        (np.float64([7.5]).tobytes(), np.float64([np.inf]).tobytes()),
    ):
        content = content.replace(there, infinite, 1)
    path.write_bytes(content)
    refused(io.read_pose, path, "pose: expected finite numbers|expected a number or null .* got inf")


def test_folders_named_with_digits_that_are_no_numbers(tmp_path: Path) -> None:
    for name in ("\u00b2", "cam" + "1" * 200, "cam2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0.json").write_text('{"people": []}')
    names = [f"cam{k}" for k in range(3)]
    found = io.read_detections(tmp_path, names, layout="coco17", order="sorted")
    assert [path.name for path in found.sources] == ["cam2", "cam" + "1" * 200, "\u00b2"]


def test_names_of_c3d_beyond_ascii_are_written_as_trc(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    path = tmp_path / "p.c3d"
    io.write_c3d(path, io.PoseData(np.ones((2, 1, 3)), ("\u00c4bc",), np.arange(2) + 1, "mm", frame_rate=9.0))
    path.write_bytes(path.read_bytes().replace("\u00c4bc".encode(), b"\xe9abc"))
    assert convert_poses(path, tmp_path / "p.trc").joint_names == ("\u00e9abc",)
    assert io.read_pose(tmp_path / "p.trc").joint_names == ("\u00e9abc",)
    with pytest.raises(sk.InvalidInputError, match="joint_names: expected texts in Unicode"):
        io.PoseData(np.ones((1, 1, 3)), ("\udce9",), np.arange(1), "mm")


CAMERA = (
    "[cameras.a]\ncam_id = 0\nsize = [9, 9]\nmatrix = [[9, 0, 4], [0, 9, 4], [0, 0, 1]]\n"
    "distortions = [0, 0, 0, 0]\ntranslation = [0, 0, 1]\nrotation = "
)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        ("[[1, 0, 0], [0, 1], [0, 0, 1]]", "expected 3×3 numbers, got lists of different lengths"),
        ("[[1, 0, 0], 2, [0, 0, 1]]", "expected 3×3 numbers, got lists of different lengths"),
        ("[[1, 0, 0], [0, 1, 0]]", "expected 3×3 numbers, got 2×3 numbers"),
        ("[1e308, 1e308, 0]", r"expected a rotation vector in radians, of a length of at most 12.6"),
        ("[[1e308, 0, 0], [0, 1, 0], [0, 0, 1]]", "R of camera 'cam_0': expected an orthonormal"),
        ("[1, 2]", "expected 3 numbers"),
    ],
)
def test_rotations_that_are_none(tmp_path: Path, rotation: str, message: str) -> None:
    for text in (CAMERA, CAMERA.replace("cam_id = 0\n", "").replace("cameras.", "")):
        if "[[" in rotation and text != CAMERA:
            continue
        path = tmp_path / "c.toml"
        path.write_text(text + rotation)
        refused(calibration, path, message)


def test_a_layout_that_is_no_name(tmp_path: Path) -> None:
    views = {name: {"custom": [np.full((3, 17, 2), 5.0)]} for name in ("cam0", "cam1")}
    metadata = np.array({"layout_name": ["coco"]}, dtype=object)
    path = tmp_path / "d.npz"
    np.savez(path, positions_2d=np.array(views, dtype=object), metadata=metadata)
    assert detections(path).people.shape == (3, 2, 1, 17, 3)


CROWDS = {
    "places in csv": (
        "d.csv",
        "frame,joint,x,y,camera\n" + "".join(f"{k},9999,5,5,cam0\n" for k in range(5000)),
        "joint: expected at most 1.* got 1.2 GB",
    ),
    "names in csv": (
        "d.csv",
        "frame,joint,x,y,camera\n" + "".join(f"{k},j{k},5,5,cam0\n" for k in range(5000)),
        "joint: expected at most 1.* got 600.0 MB",
    ),
    "points of Caliscope": (
        "xy_x.csv",
        "sync_index,cam_id,keypoint_id,img_loc_x,img_loc_y\n"
        + "".join(f"{k},0,9999,5,5\n" for k in range(5000)),
        "point: expected at most 1.* got 1.2 GB",
    ),
    "cameras": (
        "d.csv",
        "frame,joint,x,y,camera\n" + "".join(f"0,0,5,5,c{k}\n" for k in range(5000)),
        "views: expected at most 4096, with names of at most 255 characters, got 5000",
    ),
    "nulls": (
        "p.json",
        '{"format": "skelsplat-poses", "version": 1, "unit": "mm", "joint_names": ['
        + ",".join(f'"{k}"' for k in range(5000))
        + '], "frames": ['
        + ",".join('{"frame": 1, "pose": null}' for _ in range(5000))
        + "]}",
        "pose: expected at most 1.* got 600.0 MB",
    ),
    "a name": (
        "d.csv",
        f"frame,joint,x,y,camera\n0,0,5,5,cam0\n0,0,5,5,{'a1' * 5000}\n",
        "views: .* got 2, with names of at most 10000",
    ),
}


@pytest.mark.parametrize("case", CROWDS)
def test_a_table_does_not_grow_with_the_square_of_its_lines(tmp_path: Path, case: str) -> None:
    name, text, message = CROWDS[case]
    (tmp_path / name).write_text(text)
    refused(io.read_pose if name == "p.json" else detections, tmp_path / name, message)


def test_one_crowd_in_a_long_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_budget, "_available", lambda: 10**8)
    person = '{"image_id": %d, "keypoints": [' + ", ".join(["5", "5", "0.5"] * 17) + "]}"
    people = [person % k for k in range(1000)] + [person % 0] * 200
    for name in ("cam0", "cam1"):
        (tmp_path / f"{name}.json").write_text(f"[{','.join(people)}]")
    refused(detections, tmp_path, r"people: expected what fits into memory \(100.0 MB .* got .* 164.0 MB")


def test_names_of_many_words_are_compared_in_little_time() -> None:
    from skelsplat.io.detections._match import Candidates, match_by_name

    views = {str(k): f"a{k}x" * 40 for k in range(40)}
    with pytest.raises(sk.DatasetError, match="views: expected"):
        match_by_name(
            Candidates(Path(), "view", views), [f"b{k}y" * 40 for k in range(40)], allow_missing=False
        )


def test_a_calibration_has_not_any_number_of_cameras(tmp_path: Path) -> None:
    one = '"%d": {"K": [9,0,4,0,9,4,0,0,1], "RT": [1,0,0,0,0,1,0,0,0,0,1,0], "imgSize": [9, 9]}'
    path = tmp_path / "c.json"
    path.write_text("{" + ",".join(one % k for k in range(4097)) + "}")
    refused(calibration, path, "cameras: expected at most 4096 cameras .* got 4097 cameras")


# where a file is opened without asking the budget: those of this package, and what was written a moment ago
_OWN = {
    "_budget.py": "the budget itself",
    "_atomic.py": "writes",
    "_batches.py": "writes",
    "_lock.py": "writes",
    "io/_rows.py": "files of its own; others after a look",
    "io/sample.py": "part of the package",
    "io/poses/_c3d.py": "what its child wrote a moment ago",
    "io/poses/_c3d_child.py": "the kernel, of this process",
    "evaluation/reported/__init__.py": "part of the package",
    "evaluation/runs.py": "with a checksum",
    "viz/report/_parts.py": "part of the package",
    "run/html.py": "written a moment ago",
    "run/long/_gather.py": "written a moment ago",
    "detect/_mediapipe.py": "the null device",
}


def test_no_reader_opens_a_file_past_the_budget() -> None:
    package = Path(sk.__file__).parent
    opens = re.compile(
        r"\.open\(\"[ra]|\.read_(text|bytes)\(|(?<![\w.])(?<!def )open\("
        r"|np\.(load|fromfile)\(|ZipFile\(path|json\.load\("
    )
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if opens.search(path.read_text(encoding="utf-8"))
    }
    assert found - set(_OWN) == set()
