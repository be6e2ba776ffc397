"""Reads a C3D file with ezc3d in a process of its own, which a damaged file can end; `_c3d` starts it.

The process imports no more than NumPy and ezc3d, and not this package.
"""

import contextlib
import importlib
import json
import pathlib
import sys
from typing import Any

_GROUPS = {"POINT": ("LABELS", "UNITS", "RATE", "Y_SCREEN"), "SKELSPLAT": ("FRAME_SHIFT", "PROCESSING")}
_NUMBERS = ("RATE", "FRAME_SHIFT")


def read(source: str, target: str, memory: int, seconds: int) -> None:
    """Write points, residuals and parameters of a C3D file as npz, or the reason why not.

    ``memory`` is in bytes beyond what the process has, ``seconds`` of its processor's time.
    """
    np, ezc3d = importlib.import_module("numpy"), importlib.import_module("ezc3d")
    _limit(memory, seconds)
    try:
        file = ezc3d.c3d(source)
        parameters = {
            group: {
                name: [float(value) if name in _NUMBERS else _text(value) for value in entry["value"]]
                for name, entry in file["parameters"].get(group, {}).items()
                if name.rstrip("23456789") in known  # labels continue in LABELS2 to LABELS9
            }
            for group, known in _GROUPS.items()
        }
        points = file["header"]["points"]
        about = {"parameters": parameters, **{k: int(points[k]) for k in ("first_frame", "last_frame")}}
        arrays = {"points": file["data"]["points"], "residuals": file["data"]["meta_points"]["residuals"]}
    except Exception as error:
        about, arrays = {"error": (str(error).strip().splitlines() or [type(error).__name__])[-1]}, {}
    np.savez(target, about=np.frombuffer(json.dumps(about).encode(), np.uint8), **arrays)


def _text(value: Any) -> str:
    """Return text, which older programs write in Latin-1."""
    content = str(value).encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _held() -> int:
    """Return the pages of data of this process; the resource usage of a child begins with its parent's."""
    with contextlib.suppress(OSError, IndexError, ValueError):
        return int(pathlib.Path("/proc/self/statm").read_text().split()[5])
    return 2**17  # of 4 kB: numpy and ezc3d with room


def _limit(memory: int, seconds: int) -> None:
    with contextlib.suppress(ImportError, OSError, ValueError):  # Windows has no limits, macOS not all
        import resource

        used = _held() * resource.getpagesize()
        for what, most in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, seconds),
            (resource.RLIMIT_DATA, used + memory),
        ):
            hard = resource.getrlimit(what)[1]
            within = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(what, (within, hard))


if __name__ == "__main__":
    sys.path[:] = sys.argv[5:]
    read(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
