"""Human3.6M (Ionescu et al. 2014) in the layouts in which it is passed around; 17 joints, four cameras, mm.

==============  ========================================================================================
format          files
==============  ========================================================================================
``skelsplat``   the method's authors: ``3d_gt/``, ``2d_<detector>/``, ``cameras/camera-parameters.json``
``karfly``      learnable triangulation: ``human36m-multiview-labels-*.npy``
``adafuse``     AdaFuse, H36M-toolbox: ``h36m_validation.pkl``
``videopose3d`` ``data_3d_h36m.npz``, ``data_2d_h36m_*.npz`` and ``camera-parameters.json``
==============  ========================================================================================

Take keys are ``"S9/Directions 1"`` where a format keeps the names of the original files, and
``"S9/Directions-1"`` where it numbers the two takes of an action; these are not the same takes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from skelsplat.datasets._detections import choose_detector, detector_name
from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets.human36m import _adafuse, _authors, _karfly, _videopose3d
from skelsplat.datasets.human36m._common import (
    ACTIONS,
    ALIASES,
    CAMERAS,
    FPS,
    SUBJECTS,
    Options,
    take_order,
)
from skelsplat.exceptions import DatasetError, one_of
from skelsplat.layouts import H36M17

__all__ = ["ACTIONS", "ALIASES", "CAMERAS", "FORMATS", "read", "read_occluded"]

_LAYOUTS: dict[str, ModuleType] = {
    module.NAME: module for module in (_videopose3d, _karfly, _adafuse, _authors)
}
FORMATS = tuple(_LAYOUTS)
VARIANTS = ("2", "3", "3-hard")


def read(
    root: Path,
    survey: Survey,
    *,
    format: str | None = None,
    subjects: Sequence[str] | None = SUBJECTS,
    detector: str | None = None,
    detections: Path | str | None = None,
    cameras: Path | str | None = None,
    monocular: str | None = None,
) -> Dataset:
    """Read Human3.6M.

    Parameters
    ----------
    root : Path
        The folder, or the file of a format that is one file.
    subjects : sequence of str or None
        Default: the two that the method is tested on. None reads all.
    cameras : path, optional
        ``camera-parameters.json``, if it lies elsewhere.
    """
    options = Options(subjects, detector, detections, cameras, monocular)
    return _read("human36m", "Human3.6M", *_find_format(root, format), options, survey)


def read_occluded(
    root: Path,
    survey: Survey,
    *,
    variant: str | int | None = None,
    subjects: Sequence[str] | None = SUBJECTS,
    detector: str | None = None,
    detections: Path | str | None = None,
    cameras: Path | str | None = None,
    monocular: str | None = None,
) -> Dataset:
    """Read Human3.6M-Occ: Human3.6M with objects pasted over the person in two or three of the four views.

    The layout of the method's authors, one folder per variant: ``…occ-2``, ``…occ-3``, ``…occ-3-hard``. The
    truth and the cameras are those of Human3.6M.

    Parameters
    ----------
    root : Path
        The folder of the variant, or the folder that holds those of the variants.
    variant : {"2", "3", "3-hard"}, optional
        Needed if `root` holds several.
    """
    folder, found = _locate(root, variant)
    options = Options(subjects, detector, detections, cameras, monocular)
    origin = f"Human3.6M-Occ-{found}" if found else "Human3.6M-Occ, variant unknown"
    return _read("human36m-occ", origin, *_find_format(folder, _authors.NAME), options, survey)


def _read(dataset: str, origin: str, name: str, place: Path, options: Options, survey: Survey) -> Dataset:
    """Read a data set that lies at `place` in the layout `name`, takes in the order of the tables."""
    module, survey.format = _LAYOUTS[name], name
    detector, add = _detections(module, place, options, survey)
    takes: list[Take] = list(module.takes(place, options, survey))
    if add is not None:
        takes = list(survey.each(add, takes))
        left_out = [take.key for take in takes if take.detections is None]
        takes = [take for take in takes if take.detections is not None]
        survey.notes += [f"left out, without detections: {', '.join(left_out)}"] if left_out else []
    if name == _authors.NAME and options.monocular is not None:
        takes = list(survey.each(_authors.with_monocular(survey, place, options.monocular), takes))
    if not takes:
        raise DatasetError(place, "takes", "at least one", "none")
    words = {None: "without detections", "gt": "detections are the projected truth (oracle)"}
    source = f"{origin}, {name} layout; {words.get(detector, f'detections of {detector}')}"
    takes = [replace(take, fps=FPS) for take in sorted(takes, key=take_order)]
    return Dataset(dataset, H36M17, tuple(takes), detector, source, tuple(survey.notes))


def _detections(
    module: ModuleType, place: Path, options: Options, survey: Survey
) -> tuple[str | None, Callable[[Take], Take] | None]:
    """Return the detector, and what gives a take its detections if there are any for it."""
    if options.detections is not None:
        path = survey.find([Path(options.detections)], "folder of detections")
        return detector_name(options.detector or path.stem), _authors.adding(path, survey)
    if not hasattr(module, "detectors"):
        return module.DETECTOR, None
    there: dict[str, Path] = module.detectors(place)
    detector = choose_detector(survey, there, options.detector, place / module.USUAL)
    if detector is None:
        return None, None
    if len(there) > 1 and options.detector is None:
        survey.notes.append(f"detector {detector} of {', '.join(sorted(there))}")
    return detector, module.adding(there[detector], survey)


def _find_format(root: Path, format: str | None) -> tuple[str, Path]:
    """Return the layout on disk, and the folder or file that it begins at; refuse none, or several."""
    one_of("format", format, (None, *_LAYOUTS))
    wanted = _LAYOUTS if format is None else {format: _LAYOUTS[format]}
    places = {name: module.locate(root) for name, module in wanted.items()}
    found = [(name, place) for name, place in places.items() if place is not None]
    if not found:
        expected = " or ".join(f"{module.HAS} (format {name})" for name, module in wanted.items())
        raise DatasetError(root, "format", expected, "none of these")
    if len(found) > 1:
        several = ", ".join(f"{name} at {place}" for name, place in found)
        raise DatasetError(root, "format", "files of one format, or the option format", several)
    return found[0]


def _variant_of(name: str) -> str | None:
    """Return the variant that a folder's name ends with."""
    match = re.search(r"occ[-_ ]?([23])[-_ ]?(hard|h)?$", name.lower())
    return None if match is None else match[1] + ("-hard" if match[2] else "")


def _locate(root: Path, variant: str | int | None) -> tuple[Path, str | None]:
    """Return the folder of the variant, and which it is; None if nothing states it."""
    wanted = None if variant is None else str(variant).lower()
    one_of("variant", wanted, (None, *VARIANTS))
    inside = {_variant_of(path.name): path for path in sorted(root.iterdir()) if path.is_dir()}
    folders = {name: path for name, path in inside.items() if name is not None}
    if (root / "3d_gt").is_dir() or not folders:
        own = _variant_of(root.resolve().name)
        if wanted is not None and own not in (None, wanted):
            raise DatasetError(root, "variant", wanted, f"a folder of {own}")
        return root, wanted or own
    if wanted is None and len(folders) == 1:
        wanted = next(iter(folders))
    if wanted is None or wanted not in folders:
        expected = f"one of {', '.join(VARIANTS)}" if wanted is None else f"a folder …occ-{wanted}"
        raise DatasetError(root, "variant", expected, f"none chosen of {', '.join(folders)}")
    return folders[wanted], wanted
