"""Joint layouts: names, limbs, symmetric pairs in three tiers, occlusion-prone joints.

``H36M17`` and its siblings are people's; the joint orders are those of the data sets' own tools. Every
argument ``layout`` takes a `skelsplat.Layout`, the name of a built-in one (`names`), or the path of a layout
file in TOML (`read`, `write`). The built-in ones that are not compiled are such files themselves.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skelsplat._atomic import atomic_write_text
from skelsplat._budget import read_toml
from skelsplat._fields import Field
from skelsplat._skelsplat import LAYOUT_NAMES, Layout
from skelsplat.exceptions import DatasetError, InvalidInputError, did_you_mean
from skelsplat.layouts._files import SUFFIX, about_of, read_file
from skelsplat.layouts._files import About as About
from skelsplat.layouts._files import from_names as from_names
from skelsplat.layouts._files import mirrored_names as mirrored_names
from skelsplat.layouts._files import to_toml as to_toml

H36M17 = Layout.by_name("h36m17")
COCO17 = Layout.by_name("coco17")
PANOPTIC19 = Layout.by_name("panoptic19")
OCCLUSION_PERSON15 = Layout.by_name("occlusion_person15")
BODY25 = Layout.by_name("body25")
BODY25B = Layout.by_name("body25b")
HALPE26 = Layout.by_name("halpe26")
SHELF14 = Layout.by_name("shelf14")
MEDIAPIPE33 = Layout.by_name("mediapipe33")

_FOLDER = Path(__file__).with_name("data")
_ABOUT = _FOLDER / f"about{SUFFIX}"  # of the compiled ones
_IN_FILES = sorted(path.stem for path in _FOLDER.glob(f"*{SUFFIX}") if path != _ABOUT)

#: Names of the built-in layouts, as `get` and every argument ``layout`` take them.
names: tuple[str, ...] = (*LAYOUT_NAMES, *_IN_FILES)


def mirror_images(n_joints: int, left_right: Iterable[tuple[int, int]]) -> npt.NDArray[np.int64]:
    """Return the place of every joint's mirror image, (N,); its own where it has none."""
    places = np.arange(n_joints)
    for left, right in left_right:
        places[left], places[right] = right, left
    return places


def get(name: str | os.PathLike[str] | Layout) -> Layout:
    """Return the built-in layout of this name, in any case, or read the layout file at a path (``.toml``)."""
    if isinstance(name, Layout):
        return name
    if not isinstance(name, str | os.PathLike):
        raise InvalidInputError(f"layout: expected a name, a path or a Layout, got {type(name).__name__}")
    text = os.fspath(name)
    if text.lower() in names:
        return _built_in(text.lower())
    if Path(text).suffix.lower() == SUFFIX:
        return read(text)
    expected = f"one of {', '.join(names)}, or a layout file ({SUFFIX})"
    raise InvalidInputError(f"layout: expected {expected}, got {text!r}{did_you_mean(text.lower(), names)}")


def read(path: str | os.PathLike[str]) -> Layout:
    """Read a layout file."""
    layout, _ = read_file(Path(path))
    if layout.name in names and layout != _built_in(layout.name):
        expected = "a name of its own, as the contents are not those of the built-in layout"
        raise DatasetError(Path(path), "name", expected, layout.name)
    return layout


def write(path: str | os.PathLike[str], layout: Layout | str, *, about: About | None = None) -> None:
    """Write a layout file, which `read` reads back as the same layout.

    Its name should end in ``.toml``, by which arguments ``layout`` know it from a name. What it is for, in
    ``about``, is by default what is known of a built-in layout.
    """
    layout = get(layout)
    atomic_write_text(path, to_toml(layout, _about(layout) if about is None else about))


def named(field: Field) -> Layout:
    """Return the layout that a value in a file names, or raise `DatasetError`."""
    try:
        return get(field.value)
    except InvalidInputError as error:
        raise field.error(f"one of {', '.join(names)}", field.shown) from error


def is_built_in(layout: Layout) -> bool:
    """Whether this is one of the built-in layouts."""
    return layout.name in names and layout == _built_in(layout.name)


def about(name: str | os.PathLike[str] | Layout) -> About:
    """Return what a built-in layout or a layout file says it is for."""
    layout = get(name)
    return _about(layout) if isinstance(name, Layout) or is_built_in(layout) else read_file(Path(name))[1]


def _about(layout: Layout) -> About:
    """Return what is known of a layout: of those in the core, from a file of all."""
    if not is_built_in(layout):
        return About()
    if layout.name in _IN_FILES:
        return read_file(_FOLDER / f"{layout.name}{SUFFIX}")[1]
    return about_of(Field(_ABOUT, "", read_toml(_ABOUT))[layout.name])


@cache
def _built_in(name: str) -> Layout:
    return read_file(_FOLDER / f"{name}{SUFFIX}")[0] if name in _IN_FILES else Layout.by_name(name)
