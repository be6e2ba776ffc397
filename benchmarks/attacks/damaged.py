"""Files with each bit in turn flipped: read or refused, never a traceback or the end of the process."""

from __future__ import annotations

import os
import resource
import struct
import tempfile
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import skelsplat as sk
from attacks import attack
from skelsplat import io

_KINDS = ("refused", "read", "tracebacks", "end the process")
_LIMITS = {resource.RLIMIT_AS: 2**31, resource.RLIMIT_CPU: 10}


def _flipped(content: bytes, bits: range) -> Iterator[bytes]:
    for bit in bits:
        yield content[: bit // 8] + bytes([content[bit // 8] ^ 1 << bit % 8]) + content[bit // 8 + 1 :]


def _outcome(read: Callable[[Path], object], path: Path) -> str:
    try:
        read(path)
    except sk.SkelSplatError:
        return "refused"
    except Exception:
        return "tracebacks"
    return "read"


def _told(count: Counter[str]) -> str:
    return f"{count.total()} flips: " + ", ".join(f"{count[kind]} {kind}" for kind in _KINDS)


def _detections(path: Path) -> object:
    return io.read_detections(path, ["a", "b"], layout="mediapipe33", order="sorted")


def _npy(shape: tuple[int, ...]) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + np.full(shape, 5.0).tobytes()


@attack("14j", "every flipped bit of an npy header, in npy and npz", "no tracebacks")
def npy_bits() -> str:
    count: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        whole, packed = Path(folder, "mediapipe.npy"), Path(folder, "p.npz")
        for damaged in _flipped(_npy((2, 3, 33, 2)), range(8 * 128)):
            whole.write_bytes(damaged)
            count[
                _outcome(lambda path: io.read_detections(path, ["a", "b"], layout="mediapipe33"), whole)
            ] += 1
        for damaged in _flipped(_npy((3, 2, 3)), range(8 * 128)):
            np.savez(packed, joint_names=["a", "b"], frames=[1, 2, 3], unit="mm")
            with zipfile.ZipFile(packed, "a") as archive:
                archive.writestr("pose.npy", damaged)
            count[_outcome(io.read_pose, packed)] += 1
    return _told(count)


@attack("14k", "every flipped bit of a C3D file of 3 kB", "none ends the process", limit_s=7200.0)
def c3d_bits() -> str:
    poses = io.PoseData(np.ones((20, 3, 3)), ("a", "b", "c"), np.arange(1, 21), "mm", frame_rate=60.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "p.c3d")
        io.write_c3d(path, poses)
        count = Counter(map(_in_a_fork(path), _flipped(path.read_bytes(), range(8 * path.stat().st_size))))
    return _told(count)


def _in_a_fork(path: Path) -> Callable[[bytes], str]:
    """Return what tells the outcome of reading some content, in a process of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        io.read_pose(path)  # imports what is needed once
    _fork_the_reader()

    def tell(content: bytes) -> str:
        path.write_bytes(content)
        end, start = os.pipe()
        if not (child := os.fork()):
            for what, most in _LIMITS.items():
                resource.setrlimit(what, (most, most))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                os.write(start, _outcome(io.read_pose, path).encode())
            os._exit(0)
        os.close(start)
        with os.fdopen(end) as stream:
            outcome = stream.read()
        _, status = os.waitpid(child, 0)
        return "end the process" if status else outcome

    return tell


def _fork_the_reader() -> None:
    """Let a fork of this process be the reader of C3D files, where that is a process of its own: quicker."""
    try:
        from skelsplat.io.poses import _c3d, _c3d_child
    except ImportError:
        return  # an earlier version

    def child(source: str, target: str, memory: int, seconds: int) -> str:
        if not (reader := os.fork()):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            try:
                _c3d_child.read(source, target, memory, seconds)
            finally:
                os._exit(0)
        return _c3d.ended_with(os.waitstatus_to_exitcode(os.waitpid(reader, 0)[1]))

    _c3d._child = child
