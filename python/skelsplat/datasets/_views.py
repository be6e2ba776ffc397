"""Choosing the cameras of a take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import NDArray

from skelsplat.cameras import CameraRig
from skelsplat.datasets._model import Take
from skelsplat.exceptions import DatasetError, InvalidInputError

Views: TypeAlias = int | Sequence[int | str] | None
"""The first so many cameras, or some of them by place or name, or (None) all."""


def places(path: Path, names: Sequence[str], views: Views) -> list[int]:
    """Places of the chosen cameras among `names`, in the order chosen.

    `path` is the file that lists the cameras, for messages.

    Raises
    ------
    InvalidInputError
        If a camera is chosen twice, or none is.
    DatasetError
        If there are fewer cameras than chosen, or one is not there.
    """
    if views is None:
        return list(range(len(names)))
    if isinstance(views, int):
        views = list(range(views))
    chosen = [_place(path, names, view) for view in views]
    if not chosen or len(set(chosen)) < len(chosen):
        raise InvalidInputError(f"views: expected at least one camera and none twice, got {list(views)}")
    return chosen


def _place(path: Path, names: Sequence[str], view: int | str) -> int:
    there = f"{len(names)} ({', '.join(names)})"
    if isinstance(view, str):
        if view not in names:
            raise DatasetError(path, "cameras", f"camera {view!r}", there)
        return names.index(view)
    if not 0 <= view < len(names):
        raise DatasetError(path, "cameras", f"at least {view + 1} cameras", there)
    return view


def with_views(take: Take, chosen: Sequence[int]) -> Take:
    """Return the take with only the cameras at these places; monocular poses go with their cameras."""
    if list(chosen) == list(range(len(take.rig))):
        return take

    def some(value: NDArray[Any] | None) -> Any:
        return None if value is None else value[:, list(chosen)]

    per_view = take.monocular is not None and take.monocular.shape[1] == len(take.rig)
    return replace(
        take,
        rig=CameraRig([take.rig[i] for i in chosen], take.rig.unit),
        detections=some(take.detections),
        boxes=some(take.boxes),
        visible=some(take.visible),
        monocular=some(take.monocular) if per_view else take.monocular,
    )
