"""Human3.6M written in every layout, and what a refusal of it has to say."""

from __future__ import annotations

import re

import pytest

from skelsplat import DatasetError, datasets
from writers import human36m as write

FORMATS = ("skelsplat", "karfly", "adafuse", "videopose3d")
# float32 keeps 2⁻²⁴ of the largest coordinate, about 5 m or 1000 px.
TOLERANCE = {"skelsplat": 1e-9, "karfly": 1e-3, "adafuse": 1e-9, "videopose3d": 1e-3}
ALIASES = {"TakingPhoto": "Photo"}


def write_as(name, root, recording):
    """Write a recording in a layout; return the options to read it with."""
    if name == "karfly":
        write.write_karfly(root, recording)
        write.write_detections(root / "2d_cpn", recording, numbered=True)
        return {"detections": root / "2d_cpn"}
    {
        "skelsplat": write.write_skelsplat,
        "adafuse": write.write_adafuse,
        "videopose3d": write.write_videopose3d,
    }[name](root, recording)
    return {}


def refused(root, options, file, *words):
    """Read, and check that the error names the file and holds the words."""
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", root, **options)
    message = str(caught.value)
    assert caught.value.path.is_relative_to(root)
    assert file in str(caught.value.path)
    for word in words:
        assert re.search(word, message), message
    report = datasets.check("human36m", root, **options)
    assert not report.ok
    return caught.value
