"""What the entries of several formats share: lenses, rotations, and what is assumed of cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat._fields import Field
from skelsplat.cameras import matrix_from_vector
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io.calibration._format import RawCamera

_PINHOLE_COUNTS = (4, 5, 8, 12, 14)
_FISHEYE_COUNT = 4
GOOD_FIT_PX = 0.1  # a lens that is followed this well is lost in any detector's noise
SKEW = "skew is not supported; the cameras turned by half of it agree"
_MOST_RADIANS = 4 * np.pi  # optimisers pass a turn, but not two


def camera_of(
    entry: Field,
    name: str | None = None,
    *,
    K: str = "K",
    R: str | Array = "R",
    t: str = "t",
    lens: str | None = None,
    size: str | None = None,
    own: bool = False,
) -> RawCamera:
    """Return the camera of an entry, under these names; a rotation may be given as a matrix.

    With ``own``, the entry may state what this package writes of a camera: ``fisheye`` and ``clock``.
    """
    fisheye = own and entry["fisheye"].flag()
    return RawCamera(
        name=entry["name"].text() if name is None else name,
        K=entry[K].numbers((3, 3)),
        R=entry[R].numbers((3, 3)) if isinstance(R, str) else R,
        t=entry[t].numbers((3,)),
        distortion=None if lens is None else lens_of(entry[lens], fisheye=fisheye),
        size=None if size is None else entry[size].size(),
        fisheye=fisheye,
        clock=entry["clock"].number() if own and "clock" in entry else 0.0,
    )


def lens_of(field: Field, *, fisheye: bool = False) -> Array | None:
    """Return lens coefficients in a number that OpenCV has; None if the file says null."""
    if field.is_missing:  # a misspelt key must not pass for a camera without a lens
        raise field.error("lens coefficients, zeros for no lens", "none")
    if field.value is None:
        return None
    values = field.numbers(None)
    # FreeMoCap pads the four fisheye coefficients with a zero
    if fisheye and values.size == _FISHEYE_COUNT + 1 and values[-1] == 0.0:
        values = values[:_FISHEYE_COUNT]
    counts = (_FISHEYE_COUNT,) if fisheye else _PINHOLE_COUNTS
    if values.size not in counts:
        expected = f"{' or '.join(map(str, counts))} {'fisheye' if fisheye else 'lens'} coefficients"
        raise field.error(expected, f"{values.size} of them")
    return values


def matrix_of(fx: float, fy: float, cx: float, cy: float) -> Array:
    """Return K (3, 3) of focal lengths and principal point, pixels."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def rotation_of(field: Field) -> Array:
    """Return the rotation that a field holds as a matrix, by rows, or as a vector (Rodrigues, radians)."""
    value = field.value
    rows = value if isinstance(value, list) and len(value) > 1 else []
    if len(rows) == 9:
        return field.numbers((9,)).reshape(3, 3)
    if any(isinstance(row, list) and len(row) > 1 for row in rows):
        return field.numbers((3, 3))
    vector = field.numbers((3,))
    if math.hypot(*vector) > _MOST_RADIANS:
        expected = f"a rotation vector in radians, of a length of at most {_MOST_RADIANS:.3g}"
        raise field.error(expected, f"{field.shown}, as in degrees")
    return matrix_from_vector(vector)


def cameras_of(path: Path, names: Sequence[str]) -> Subject:
    """Return cameras of a file, as what a finding concerns."""
    return Subject(cameras=tuple(names), files=(str(path),))


def warn_of_no_lens(path: Path, names: Sequence[str]) -> None:
    """Warn that a file has no lens coefficients for these cameras, if there are any."""
    words = f"{path}: no distortions for {', '.join(names)}: assumed to have no lens distortion."
    if names:
        warn(Finding("calibration_read_as", "note", cameras_of(path, names), sentence=words))


def warn_of_fit(path: Path, errors: dict[str, float], how: str) -> None:
    """Warn that lenses or skew of cameras are followed with errors in px, largest in the corners."""
    names = [name for name, error in errors.items() if error > GOOD_FIT_PX]
    worst = max(errors.values(), default=0.0)
    words = f"{path}: {', '.join(names)}: {how} to {worst:.2g} px at worst."
    if names:
        numbers = {"error_px": worst}
        warn(Finding("calibration_read_as", "note", cameras_of(path, names), numbers, sentence=words))


def without_skew(K: Array) -> tuple[Array, Array, float]:
    """Return a camera matrix without skew, the turn about the optical axis, and the largest error in px.

    The turn takes half of the skew in x and leaves as much in y, the least that is possible at the edge of an
    image that reaches to twice the principal point.
    """
    skew, (fx, fy), (cx, cy) = K[0, 1], K[[0, 1], [0, 1]], np.abs(K[:2, 2])
    sine = -skew / (fx + fy)
    cosine = np.sqrt(1.0 - sine**2)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    plain = matrix_of(fx, fy, K[0, 2], K[1, 2])
    edge = np.array([cx / fx, cy / fy])
    return plain, turn, float(np.abs((K - plain @ turn)[:2, :2] @ edge).max())
