"""Joint layouts: names, limbs, symmetric pairs in three tiers, occlusion-prone joints.

``H36M17`` and its siblings are the built-in ones; ``skelsplat.Layout(...)`` makes one's own. Joint orders are
those of the data sets' own tools.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from skelsplat._skelsplat import LAYOUT_NAMES, Layout

H36M17 = Layout.by_name("h36m17")
COCO17 = Layout.by_name("coco17")
PANOPTIC19 = Layout.by_name("panoptic19")
OCCLUSION_PERSON15 = Layout.by_name("occlusion_person15")
BODY25 = Layout.by_name("body25")
BODY25B = Layout.by_name("body25b")
HALPE26 = Layout.by_name("halpe26")
SHELF14 = Layout.by_name("shelf14")
MEDIAPIPE33 = Layout.by_name("mediapipe33")

#: Names of the built-in layouts, all of them people's, as `get` and every argument ``layout`` take them.
names: tuple[str, ...] = tuple(LAYOUT_NAMES)

__all__ = [
    "BODY25",
    "BODY25B",
    "COCO17",
    "H36M17",
    "HALPE26",
    "MEDIAPIPE33",
    "OCCLUSION_PERSON15",
    "PANOPTIC19",
    "SHELF14",
    "get",
    "names",
]


def mirror_images(n_joints: int, left_right: Iterable[tuple[int, int]]) -> npt.NDArray[np.int64]:
    """Return the place of every joint's mirror image, (N,); its own where it has none."""
    places = np.arange(n_joints)
    for left, right in left_right:
        places[left], places[right] = right, left
    return places


def get(name: str) -> Layout:
    """Return the built-in layout called ``name``, in lower or upper case.

    Raises
    ------
    InvalidInputError
        If there is none of that name; the message lists all names.
    """
    return Layout.by_name(name)
