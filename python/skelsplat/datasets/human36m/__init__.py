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
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset
from skelsplat.datasets.human36m import _adafuse, _authors, _karfly, _videopose3d
from skelsplat.datasets.human36m._common import ACTIONS, CAMERAS, Options, Reading, with_separate
from skelsplat.exceptions import DatasetError, one_of

__all__ = ["ACTIONS", "CAMERAS", "DESCRIPTION", "FORMATS", "OCCLUDED", "OPTIONS", "read", "survey"]

DESCRIPTION = "Human3.6M: 4 cameras, 17 joints; formats skelsplat, karfly, adafuse, videopose3d"

_LAYOUTS: dict[str, ModuleType] = {
    module.NAME: module for module in (_videopose3d, _karfly, _adafuse, _authors)
}
FORMATS = tuple(_LAYOUTS)
OPTIONS = tuple(entry.name for entry in fields(Options))


def read(root: Path, *, format: str | None = None, **options: Any) -> Dataset:
    """Read Human3.6M.

    Parameters
    ----------
    root : Path
        The folder, or the file of a format that is one file.
    format : str, optional
        One of `FORMATS`; found from the files when left out.
    **options
        The attributes of `Options`.

    Raises
    ------
    InvalidInputError
        If an option has a value that is none of those possible.
    DatasetError
        If a file is missing or malformed; it names the file and the field.
    """
    chosen = Options.parse(**options)
    name, place = find_format(root, format)
    return read_layout("human36m", name, place, chosen, "Human3.6M")


def survey(root: Path, options: Mapping[str, Any]) -> Survey:
    """Say which files of Human3.6M are there, and which are missing; options as for `read`."""
    chosen = Options.parse(**{name: options[name] for name in OPTIONS if name in options})
    try:
        name, place = find_format(root, options["format"])
    except DatasetError as error:
        return Survey(missing=[(root, error.expected)])
    found = Survey(format=name)
    _LAYOUTS[name].survey(place, chosen, found)
    if chosen.detections is not None:
        found.look([chosen.detections], "the detections")
    return found


def read_layout(dataset: str, name: str, place: Path, options: Options, origin: str) -> Dataset:
    """Read a data set that lies at `place` in the layout `name`."""
    reading = Reading(origin=f"{origin}, {name} layout")
    takes = _LAYOUTS[name].takes(place, options, reading)
    reading.takes += with_separate(takes, options, reading)
    if name == _authors.NAME and options.monocular is not None:
        reading.takes = [_authors.with_monocular(take, place, options.monocular) for take in reading.takes]
    return reading.dataset(dataset, place)


def find_format(root: Path, format: str | None) -> tuple[str, Path]:
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


VARIANTS = ("2", "3", "3-hard")


class Occluded:
    """Human3.6M-Occ: Human3.6M with objects pasted over the person in two or three of the four views.

    The layout of the method's authors, one folder per variant: ``…occ-2``, ``…occ-3``, ``…occ-3-hard``. The
    truth and the cameras are those of Human3.6M.
    """

    DESCRIPTION = "Human3.6M-Occ: occluded views; variants 2, 3, 3-hard; authors' layout"
    OPTIONS = OPTIONS

    def read(self, root: Path, *, variant: str | int | None = None, **options: Any) -> Dataset:
        """Read a variant of Human3.6M-Occ.

        Parameters
        ----------
        root : Path
            The folder of the variant, or the folder that holds those of the variants.
        variant : {"2", "3", "3-hard"}, optional
            Needed if `root` holds several.
        **options
            The attributes of `Options`.

        Raises
        ------
        InvalidInputError
            If the variant is unknown.
        DatasetError
            If files are missing or malformed, or `root` holds several variants and none is chosen.
        """
        chosen = Options.parse(**options)
        folder, found = _locate(root, variant)
        name, place = find_format(folder, _authors.NAME)
        origin = f"Human3.6M-Occ-{found}" if found else "Human3.6M-Occ, variant not said"
        return read_layout("human36m-occ", name, place, chosen, origin)

    def survey(self, root: Path, options: Mapping[str, Any]) -> Survey:
        """Say which files are there, and which are missing; options as for `read`."""
        try:
            folder, _ = _locate(root, options["variant"])
        except DatasetError as error:
            return Survey(missing=[(error.path, error.expected)])
        return survey(folder, {**options, "format": _authors.NAME})


OCCLUDED = Occluded()


def _variant_of(name: str) -> str | None:
    """Return the variant that a folder's name ends with."""
    match = re.search(r"occ[-_ ]?([23])[-_ ]?(hard|h)?$", name.lower())
    return None if match is None else match[1] + ("-hard" if match[2] else "")


def _locate(root: Path, variant: str | int | None) -> tuple[Path, str | None]:
    """Return the folder of the variant, and which it is (None if nothing says so)."""
    wanted = None if variant is None else str(variant).lower()
    one_of("variant", wanted, (None, *VARIANTS))
    inside = {_variant_of(path.name): path for path in sorted(root.iterdir()) if path.is_dir()}
    folders = {name: path for name, path in inside.items() if name is not None}
    if (root / "3d_gt").is_dir() or not folders:
        return root, _named(root, wanted)
    if wanted is None and len(folders) == 1:
        wanted = next(iter(folders))
    if wanted is None or wanted not in folders:
        expected = f"one of {', '.join(VARIANTS)}" if wanted is None else f"a folder …occ-{wanted}"
        raise DatasetError(root, "variant", expected, f"none chosen of {', '.join(folders)}")
    return folders[wanted], wanted


def _named(root: Path, wanted: str | None) -> str | None:
    """Return the variant of a folder that is one, if its name does not contradict what was asked for."""
    own = _variant_of(root.resolve().name)
    if wanted is not None and own is not None and own != wanted:
        raise DatasetError(root, "variant", wanted, f"a folder of {own}")
    return wanted or own
