"""The files of a run: what they are for, and all of them in one."""

from __future__ import annotations

import contextlib
import os
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

from skelsplat.io._run_files import mark, run_in
from skelsplat.io.video import comment_of
from skelsplat.run.folder import PAGE

# By the end of their names, in the order in which they are offered.
_ABOUT = {
    PAGE: "the report, with the pose in 3D",
    ".trc": "markers, for OpenSim and the like",
    ".c3d": "markers, for programs of motion capture",
    ".bvh": "animation, for Blender, MotionBuilder, Unreal",
    ".glb": "animation, for Blender, Unity, the web",
    ".mp4": "the pose drawn on a video",
    ".csv": "tables, for spreadsheets, R, MATLAB",
    ".mot": "joint angles, for OpenSim",
    ".xml": "settings, for OpenSim",
    ".py": "runs OpenSim with them",
    ".npz": "arrays, for Python",
    ".nc": "arrays with names, for xarray and movement",
    ".npy": "an array, for FreeMoCap's programs",
    ".png": "a picture",
    ".json": "for programs",
}
_FOLDERS = ("overlay", "opensim", "plots", "person_")  # a demo's input is not among them


def files_of(folder: Path) -> list[tuple[str, str, int]]:
    """Return the files of a run: name, what it is for, bytes."""
    found = []
    for path in (one for one in folder.rglob("*") if one.is_file()):
        *above, name = path.relative_to(folder).parts
        if name.startswith(".") or (above and not above[0].startswith(_FOLDERS)):
            continue
        place = next((k for k, end in enumerate(_ABOUT) if name.endswith(end)), len(_ABOUT))
        about = [*_ABOUT.values(), ""][place]
        found.append((len(above), place, "/".join([*above, name]), about, path.stat().st_size))
    return [entry[2:] for entry in sorted(found)]


def videos_of_run(folder: Path) -> dict[str, bool]:
    """Return by name the videos on which a run in a folder was drawn, and whether it is the one there now."""
    now = mark(run_in(folder))
    return {path.stem: comment_of(path) == now for path in sorted((folder / "overlay").glob("*.mp4"))}


def size_of(size: int) -> str:
    """Return a number of bytes in words."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"


def zipped(folder: Path) -> Iterator[bytes]:
    """Yield the files of a run as a zip file, in pieces: nothing is written to a disk."""
    source, sink = os.pipe()

    def fill() -> None:
        with (
            contextlib.suppress(BrokenPipeError),  # the browser has gone
            os.fdopen(sink, "wb") as out,
            zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed,
        ):
            for name, _, _ in files_of(folder):
                packed.write(folder / name, name)

    threading.Thread(target=fill, daemon=True).start()
    with os.fdopen(source, "rb") as pieces:
        yield from iter(lambda: pieces.read(2**16), b"")
