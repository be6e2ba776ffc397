"""Hostile and damaged files: each has to be refused in one line, within a second and 500 MB."""

from __future__ import annotations

import os
import pickle
import resource
import socket
import struct
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from attacks import attack
from skelsplat import io

_LIMIT_S = 60.0
_ADDRESSES = 6 * 10**9  # so that no attack takes down the machine
_REFUSED = "an error, < 1 s, < 500 MB"
_CAMERAS = ["cam0", "cam1"]


def _outcome(call: Callable[[], object]) -> str:
    """Return how a call ends, after what CPU time, and by how much the process has grown."""
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        call()
        ended = "accepted"
    except Exception as error:
        ended = type(error).__name__
        ended = f"traceback ({ended})" if not isinstance(error, sk.SkelSplatError) else ended
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return f"{ended}, {time.process_time() - start:.1f} s, {grown:.0f} MB"


def _reading(name: str, content: bytes | Callable[[Path], object], read: Callable[[Path], object]) -> str:
    """Return how reading a file of this name and content ends; or one that a function makes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content)
        return _outcome(lambda: read(path))


def _calibration(path: Path) -> object:
    return io.read_calibration(path, unit="mm")


def _detections(path: Path) -> object:
    return io.read_detections(path, _CAMERAS, layout="coco17", order="sorted")


def _npz(**arrays: Any) -> Callable[[Path], None]:
    return lambda path: np.savez(path, **arrays)


def _npy_header(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _sparse(content: bytes) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.write_bytes(content)
        os.truncate(path, 80 * 10**9)

    return make


@attack("13a", "OpenCV YAML with a word of 40,000 letters", _REFUSED, limit_s=_LIMIT_S)
def yaml_word() -> str:
    text = b"%YAML:1.0\nK_a: !!opencv-matrix\n   " + b"a" * 40_000 + b"\n"
    return _reading("intri.yml", text, _calibration)


@attack("13b", "OpenCV YAML with 200,000 blanks in a line", _REFUSED, limit_s=_LIMIT_S)
def yaml_blanks() -> str:
    return _reading("intri.yml", b"%YAML:1.0\na" + b" " * 200_000 + b"b\n", _calibration)


def _leaves(depth: int, kind: type = list) -> Any:
    """Give a list (or tuple) of twice the same list of twice the same …: 2^depth leaves."""
    value: Any = kind([1.0])
    for _ in range(depth):
        value = kind([value, value])
    return value


@attack("13c", "pickle of 300 bytes with 2^30 leaves, OpenCap", _REFUSED, limit_s=_LIMIT_S)
def pickle_leaves() -> str:
    content = pickle.dumps({"intrinsicMat": _leaves(30)})
    return _reading("cameraIntrinsicsExtrinsics.pickle", content, _calibration)


@attack("13d", "npz of 1 kB with 2^30 leaves, VideoPose3D", _REFUSED, limit_s=_LIMIT_S)
def npz_leaves() -> str:
    table = {"S1": {"custom": _leaves(30)}, "S2": {"custom": _leaves(30)}}
    return _reading("data.npz", _npz(positions_2d=np.array(table, dtype=object)), _detections)


@attack("13e", "npz of 8 MB that unpacks to 8 GB", _REFUSED, limit_s=_LIMIT_S)
def zip_bomb() -> str:
    return _reading("pose.npz", _zipped_zeros, _detections)


def _zipped_zeros(path: Path) -> None:
    """Write 10^9 zeros as `detections`, without compressing each block of them."""
    header = _npy_header((10**9 // 34, 2, 17))
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packer.compress(header) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(8 * 10**7)) + packer.flush(zlib.Z_FULL_FLUSH)
    data = first + 100 * block + packer.flush()
    size = len(header) + 100 * 8 * 10**7
    name = b"detections.npy"
    sizes = struct.pack("<IIIHH", 0, len(data), 0xFFFFFFFF, len(name), 12) + name
    sizes += struct.pack("<HHQ", 1, 8, size)
    local = b"PK\3\4" + struct.pack("<HHHHH", 45, 0, 8, 0, 0) + sizes
    sizes = struct.pack("<IIIHHHHHII", 0, len(data), 0xFFFFFFFF, len(name), 12, 0, 0, 0, 0, 0) + name
    central = b"PK\1\2" + struct.pack("<HHHHHH", 45, 45, 0, 8, 0, 0) + sizes + struct.pack("<HHQ", 1, 8, size)
    end = struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local) + len(data), 0)
    path.write_bytes(local + data + central + b"PK\5\6" + end)


@attack("13f", "npy with a header that claims 80 GB", _REFUSED, limit_s=_LIMIT_S)
def npy_claim() -> str:
    return _reading("mediapipe.npy", _npy_header((2, 10**8, 25, 2)), _detections)


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        shape = (1, 2, 17, 294_117_647)
        file.create_dataset("tracks", shape, "f8", chunks=(1, 2, 17, 1024), compression="gzip")
        file["node_names"] = [f"joint_{k}" for k in range(17)]


@attack("13g", "HDF5 of SLEAP that claims 80 GB", _REFUSED, limit_s=_LIMIT_S)
def hdf5_claim() -> str:
    return _reading("cam0.h5", _hdf5, lambda path: io.read_detections(path.parent, ["cam0"], layout="coco17"))


def _netcdf(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("position", (10**8, 3, 33, 1), "f8", chunks=(1024, 3, 33, 1), compression="gzip")


@attack("13h", "NetCDF that claims 80 GB", _REFUSED, limit_s=_LIMIT_S)
def netcdf_claim() -> str:
    return _reading("pose.nc", _netcdf, io.read_pose)


def _mat(path: Path) -> None:
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    flags, dims = element(6, struct.pack("<II", 6, 0)), element(5, struct.pack("<ii", 15_000, 17_000))
    packer = zlib.compressobj(9)
    size = 8 * 15_000 * 17_000
    head = flags + dims + element(1, b"params") + struct.pack("<II", 9, size)
    data = packer.compress(struct.pack("<II", 14, len(head) + size) + head)
    data += packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(2 * 10**7)) + packer.flush(zlib.Z_FULL_FLUSH)
    data += 102 * block + packer.flush()
    start = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(start + struct.pack("<II", 15, len(data)) + data)


@attack("13i", "MAT-file of 2 MB that unpacks to 2 GB", _REFUSED, limit_s=_LIMIT_S)
def mat_bomb() -> str:
    return _reading("calib.mat", _mat, _calibration)


@attack("13j", "JSON nested 960 deep, as calibration; as poses", _REFUSED, limit_s=_LIMIT_S)
def json_deep() -> str:
    deep = "[" * 960 + "]" * 960
    start = '{"format": "skelsplat-calibration", "version": 1, "unit": "mm"'
    cameras = f'{start}, "cameras": [{{"name": "a", "K": {deep}}}]}}'
    poses = (
        f'{{"format": "skelsplat-poses", "version": 1, "joint_names": {deep}, "frames": [], "unit": {deep}}}'
    )
    return "; ".join(
        (_reading("c.json", cameras.encode(), _calibration), _reading("p.json", poses.encode(), io.read_pose))
    )


@attack("13k", "JSON nested 100,000 deep", _REFUSED, limit_s=_LIMIT_S)
def json_very_deep() -> str:
    return _reading("c.json", b"[" * 100_000 + b"]" * 100_000, _calibration)


@attack("13l", "TOML with 20,000 dotted keys of 200 parts", _REFUSED, limit_s=_LIMIT_S)
def toml_keys() -> str:
    lines = (f"k{k}.{'.'.join('a' * 200)} = 1" for k in range(20_000))
    return _reading("calibration.toml", "\n".join(lines).encode(), _calibration)


@attack("13m", "XML with entities of entities (8^9)", _REFUSED, limit_s=_LIMIT_S)
def xml_entities() -> str:
    inner = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 8}">' for k in range(9))
    text = f'<!DOCTYPE x [<!ENTITY e0 "{"a" * 99}">{inner}]><calibration>&e9;</calibration>'
    return _reading("calib.qca.txt", text.encode(), _calibration)


@attack("13n", "csv with a line of 200 MB", _REFUSED, limit_s=_LIMIT_S)
def csv_line() -> str:
    return _reading("d.csv", b"frame,joint,x,y" + b",1" * 10**8, _detections)


def _linked(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


@attack("13o", "/dev/zero as calibration, detections, poses", _REFUSED, limit_s=_LIMIT_S)
def dev_zero() -> str:
    link = _linked("/dev/zero")
    readers = {"c.json": _calibration, "d.csv": _detections, "p.trc": io.read_pose}
    return "; ".join(_reading(name, link, read) for name, read in readers.items())


@attack("13p", "a FIFO as calibration, detections, poses", _REFUSED, limit_s=_LIMIT_S)
def fifo() -> str:
    readers = {"c.json": _calibration, "d.csv": _detections, "p.trc": io.read_pose}
    return "; ".join(_reading(name, os.mkfifo, read) for name, read in readers.items())


def _socket(path: Path) -> None:
    socket.socket(socket.AF_UNIX).bind(str(path))


@attack("14a", "a socket; a folder; a loop of links as poses", _REFUSED, limit_s=_LIMIT_S)
def no_files() -> str:
    made = (_socket, Path.mkdir, lambda path: path.symlink_to(path.name))
    return "; ".join(_reading("p.json", make, io.read_pose) for make in made)


@attack("14b", "a sparse file of 80 GB as csv; npy; h5", _REFUSED, limit_s=_LIMIT_S)
def sparse_files() -> str:
    files = {
        "d.csv": b"frame,joint,x,y\n0,0,1,1\n",
        "mediapipe.npy": _npy_header((2, 10**8, 25, 2)),
        "cam0.h5": b"\x89HDF\r\n\x1a\n",
    }
    return "; ".join(_reading(name, _sparse(content), _detections) for name, content in files.items())


@attack("14c", "COCO: 2,000 people in one of 20,000 frames", _REFUSED, limit_s=_LIMIT_S)
def coco_crowd() -> str:
    person = f'{{"image_id": %d, "keypoints": [{", ".join(["5"] * 50)}, 1]}}'
    people = [person % k for k in range(20_000)] + [person % 0] * 2_000

    def make(path: Path) -> None:
        for name in ("cam0.json", "cam1.json"):
            path.with_name(name).write_text(f"[{','.join(people)}]")

    return _reading("x", make, lambda path: _detections(path.parent))


@attack("14d", "csv of 300 kB: 10,000 frames, the joint 9999 in each", _REFUSED, limit_s=_LIMIT_S)
def csv_places() -> str:
    lines = "".join(f"{k},9999,5,5,cam0\n" for k in range(10_000))
    return _reading("d.csv", f"frame,joint,x,y,camera\n{lines}".encode(), _detections)


@attack(
    "14e", "folder ²; a camera named with 5,000 digits; order sorted", "an error, or read", limit_s=_LIMIT_S
)
def odd_names() -> str:
    def folders(path: Path) -> None:
        for name in ("²", "x"):
            (path.parent / name).mkdir()
            (path.parent / name / "0.json").write_text('{"people": []}')

    lines = "".join(f"0,{j},5,5,{'1' * 5000 if m else 'x'}\n" for j in range(17) for m in range(2))
    text = f"frame,joint,x,y,camera\n{lines}".encode()
    return "; ".join(
        (_reading("y", folders, lambda path: _detections(path.parent)), _reading("d.csv", text, _detections))
    )


@attack("14f", "VideoPose3D: layout_name as a list", "an error, or read", limit_s=_LIMIT_S)
def layout_list() -> str:
    views = {name: {"custom": [np.full((3, 17, 2), 5.0)]} for name in _CAMERAS}
    metadata = {"layout_name": ["coco"]}
    make = _npz(positions_2d=np.array(views, dtype=object), metadata=np.array(metadata, dtype=object))
    return _reading("data.npz", make, _detections)


@attack(
    "14g", "pose.npz with names as bytes; frames of 5.5; written as TRC and JSON", _REFUSED, limit_s=_LIMIT_S
)
def npz_poses() -> str:
    good = {"pose": np.ones((1, 2, 3)), "joint_names": ["a", "b"], "frames": [5], "unit": "mm"}
    bad = ({"joint_names": np.array([b"a", b"b"])}, {"frames": [5.5]})

    def convert(path: Path) -> object:
        poses = io.read_pose(path)
        return io.write_trc(path.with_suffix(".trc"), poses, frame_rate=9.0), io.write_json(path, poses)

    return "; ".join(_reading("pose.npz", _npz(**{**good, **change}), convert) for change in bad)


@attack("14h", "an infinite coordinate in poses: csv; trc; npz", _REFUSED, limit_s=_LIMIT_S)
def infinite() -> str:
    csv = b"frame,joint,x,y,z,unit\n0,a,inf,1,1,mm\n"
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tx",
        "DataRate",
        "9\t9\t1\t1\tmm\t9\t1\t1",
        "Frame#\tTime\ta",
        "\t\tX1",
        "1\t0\tinf\t1\t1",
    ]
    npz = _npz(pose=np.full((1, 1, 3), np.inf), joint_names=["a"], frames=[0], unit="mm")
    files = {"p.csv": csv, "p.trc": "\n".join(lines).encode(), "p.npz": npz}
    return "; ".join(_reading(name, content, io.read_pose) for name, content in files.items())


@attack("14i", "C3D with a name of Latin letters, read and written as TRC", "the name, or an error")
def latin_name() -> str:
    def make(path: Path) -> None:
        poses = io.PoseData(np.ones((2, 1, 3)), ("\u00c4bc",), np.arange(1, 3), "mm", frame_rate=9.0)
        io.write_c3d(path, poses)
        path.write_bytes(path.read_bytes().replace("\u00c4bc".encode(), b"\xe9abc"))

    return _reading("p.c3d", make, lambda path: io.write_trc(path.with_suffix(".trc"), io.read_pose(path)))
