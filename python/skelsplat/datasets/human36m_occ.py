"""Human3.6M-Occ: Human3.6M with objects pasted over the person in two or three of the four views.

The layout of the method's authors (`skelsplat.datasets.human36m`), one folder per variant: ``…occ-2``,
``…occ-3``, ``…occ-3-hard``. The truth and the cameras are those of Human3.6M.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset
from skelsplat.datasets.human36m import OPTIONS, find_format, read_layout
from skelsplat.datasets.human36m import survey as survey_human36m
from skelsplat.datasets.human36m._common import Options
from skelsplat.exceptions import DatasetError, one_of

__all__ = ["DESCRIPTION", "OPTIONS", "VARIANTS", "read", "survey"]

DESCRIPTION = "Human3.6M-Occ: occluded views; variants 2, 3, 3-hard; authors' layout"

VARIANTS = ("2", "3", "3-hard")


def read(
    root: Path,
    *,
    variant: str | int | None = None,
    **options: Any,
) -> Dataset:
    """Read a variant of Human3.6M-Occ.

    Parameters
    ----------
    root : Path
        The folder of the variant, or the folder that holds those of the variants.
    variant : {"2", "3", "3-hard"}, optional
        Needed if `root` holds several.
    **options
        As for `skelsplat.datasets.human36m.read`.

    Raises
    ------
    InvalidInputError
        If the variant is unknown.
    DatasetError
        If files are missing or malformed, or `root` holds several variants and none is chosen.
    """
    chosen = Options.parse(**options)
    folder, found = _locate(root, variant)
    name, place = find_format(folder, "skelsplat")
    origin = f"Human3.6M-Occ-{found}" if found else "Human3.6M-Occ, variant not said"
    return read_layout("human36m-occ", name, place, chosen, origin)


def survey(root: Path, options: Mapping[str, Any]) -> Survey:
    """Say which files are there, and which are missing; options as for `read`."""
    try:
        folder, _ = _locate(root, options["variant"])
    except DatasetError as error:
        return Survey(missing=[(error.path, error.expected)])
    return survey_human36m(folder, {**options, "format": "skelsplat"})


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
