"""What a run is asked to do."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field

import skelsplat as sk
from skelsplat import temporal
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.io._arrays import FRAME_RATES
from skelsplat.io.detections import FORMATS
from skelsplat.io.detections._joints import check_layout
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.io.poses._pose_data import MARKER_NAMES
from skelsplat.run.over_time import Filter, parse_filter
from skelsplat.run.person import check_person

FRAME_MODES = ("strict", "intersection", "union")


class IncompleteJobError(InvalidInputError):
    """An option of a `Job` has no effect without another one.

    Attributes
    ----------
    option, requires : str
        Names of fields of `Job`.
    """

    def __init__(self, option: str, requires: str) -> None:
        super().__init__(f"{option}: requires {requires}")
        self.option, self.requires = option, requires


@dataclass(frozen=True)
class Job:
    """One run: where the input is, how to read it, how to refine it, and what to write.

    Parameters
    ----------
    calibration, detections : path
        The calibration file, and the folder or file of detections.
    unit, calibration_format, camera_type, subject, size, binning
        How to read the calibration, as for `skelsplat.io.read_calibration`; None: as the file states it.
    layout
        The joint layout of the detections, as `skelsplat.io.read_layout` takes it: a name, a layout file, a
        `skelsplat.Layout`, or ``"file"``; None: found from the joint names in the files.
    person
        ``"consistent"``: the person the views agree on. The others follow people over time, as
        `skelsplat.track`, and choose one: a number from 0, the identity; ``"largest"``: whoever is largest in
        the images; ``"moves-most"``; a point ``"cam01:640,360"``: whoever is there in the first frame in
        which that camera sees somebody. Without a frame rate, a number is the place in each file and
        ``"largest"`` the largest in each image, which need not be one person.
    people
        For `run_people`: ``"all"``, or a number: those whom the views see most. None: one person.
    frames
        What to do with cameras of different frame counts: ``"strict"``, ``"intersection"`` or ``"union"``.
    format
        Format of the detections, of `skelsplat.io.detections.FORMATS`; None to find it from the files.
    offsets
        By camera, frames to add to its frame numbers, also parts of one.
    order
        The source of each camera's detections, or ``"sorted"``; None to match by name.
    without
        Names of cameras that are left out; case and separators may differ.
    mapping
        By joint of the layout, its name or index in the files, where these differ; None: missing there.
    sequence
        Which sequence of a file that has several.
    init
        A pose file to start from; None for triangulation.
    init_sigma_mm
        Standard deviation per axis of that pose in mm, if it is independent of the detections; None: it
        is only the start of the search.
    config
        Settings of the method; None: the defaults of `skelsplat.RefineConfig`.
    fps
        Frames per second of the recording; None: as the files, or videos next to them, state it.
    adjust_cameras
        First adjust the cameras that were turned or moved, by the person the views agree on
        (`skelsplat.adjust_cameras`); the cameras used are written to the folder of the results.
    frame_by_frame
        Solve each frame alone even if the frame rate is known, instead of all over time (`Outcome.sequence`).
    fill_gaps
        Longest gap to fill, in frames; 0: none.
    fill_method
        ``"cubic"`` or ``"linear"``; None: cubic.
    fill_weak
        Also treat weak joints as gaps.
    filter
        A `Butterworth` or `OneEuro`, or its text (``"butterworth:6"``); it needs ``fps``. None: no filter.
    output
        Folder for the results; None: nothing is written.
    write
        The pose files to write, of `skelsplat.io.poses.POSE_FORMATS`; ``pose.npz`` is always written.
    y_up
        Write ``pose.trc`` and ``pose.c3d`` with y pointing up, for OpenSim, instead of z.
    marker_names
        What joints are called in these two, of `skelsplat.io.poses.MARKER_NAMES`.
    angles
        Write the joint angles as well, `skelsplat.joint_angles`: ``angles.csv``, ``.npz`` and ``.mot``.
    html
        Write ``report.html``.
    note
        A sentence about the input, to be shown with its numbers.

    Raises
    ------
    InvalidInputError
        If an option has no such value, or lacks another that it requires; the message begins with its name.
    """

    calibration: str | os.PathLike[str]
    detections: str | os.PathLike[str]
    _: KW_ONLY
    unit: str | None = None
    calibration_format: str | None = None
    camera_type: str | None = None
    subject: str | None = None
    size: tuple[int, int] | None = None
    binning: float | None = None
    layout: str | os.PathLike[str] | sk.Layout | None = None
    person: str | int = "consistent"
    people: str | int | None = None
    frames: str = "strict"
    format: str | None = None
    offsets: Mapping[str, float] = field(default_factory=dict)
    order: str | tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    mapping: Mapping[str, str | int | None] = field(default_factory=dict)
    sequence: str | None = None
    init: str | os.PathLike[str] | None = None
    init_sigma_mm: float | None = None
    config: sk.RefineConfig | None = None
    fps: float | None = None
    adjust_cameras: bool = False
    frame_by_frame: bool = False
    fill_gaps: int = 0
    fill_method: str | None = None
    fill_weak: bool = False
    filter: Filter | str | None = None
    output: str | os.PathLike[str] | None = None
    write: tuple[str, ...] = ("npz", "csv", "trc")
    y_up: bool = False
    marker_names: str = MARKER_NAMES[0]
    angles: bool = False
    html: bool = True
    note: str = ""

    def __post_init__(self) -> None:
        one_of("unit", self.unit, (None, *MM_PER_UNIT))
        if self.layout is not None:
            check_layout(self.layout)
        one_of("format", self.format, (None, *FORMATS))
        one_of("frames", self.frames, FRAME_MODES)
        check_person(self.person)
        self._check_people()
        self._check_start()
        _positive("fps", self.fps)
        low, high = FRAME_RATES
        if self.fps is not None and not low <= self.fps <= high:
            raise InvalidInputError(f"fps: expected a number from 1e-3 to 1e6, got {self.fps:g}")
        one_of("marker_names", self.marker_names, MARKER_NAMES)
        for kind in self.write:
            one_of("write", kind, tuple(POSE_FORMATS))
        self._check_over_time()

    def _check_people(self) -> None:
        number = isinstance(self.people, int) and not isinstance(self.people, bool) and self.people >= 1
        if self.people not in (None, "all") and not number:
            raise InvalidInputError(f"people: expected all or a number of at least 1, got {self.people!r}")
        if self.people is not None:
            for option, unset in (("person", "consistent"), ("init", None)):
                if getattr(self, option) != unset:
                    together = "cannot be combined with people, which refines everybody"
                    raise InvalidInputError(f"{option}: {together}")

    def _check_start(self) -> None:
        _positive("init_sigma_mm", self.init_sigma_mm)
        if self.init_sigma_mm is None:
            return
        if self.init is None:
            raise IncompleteJobError("init_sigma_mm", "init")
        if self.settings.method == "paper":
            why = "with the method paper, whose start is not an observation"
            raise InvalidInputError(f"init_sigma_mm: expected none {why}, got {self.init_sigma_mm:g}")

    def _check_over_time(self) -> None:
        one_of("fill_method", self.fill_method, (None, *temporal.METHODS))
        for option in ("fill_weak", "fill_method"):
            if getattr(self, option) and not self.fill_gaps:
                raise IncompleteJobError(option, "fill_gaps")
        if self.low_pass is not None and self.fps is None:
            raise IncompleteJobError("filter", "fps")

    @property
    def settings(self) -> sk.RefineConfig:
        """The settings of the method."""
        return sk.RefineConfig() if self.config is None else self.config

    @property
    def low_pass(self) -> Filter | None:
        """The filter, read if it was given as text."""
        return parse_filter(self.filter) if isinstance(self.filter, str) else self.filter

    @property
    def interpolation(self) -> str:
        """How gaps are filled."""
        return self.fill_method or temporal.METHODS[0]

    @property
    def pose_formats(self) -> tuple[str, ...]:
        """The pose files to write: npz, and those of ``write``, each once."""
        return tuple(dict.fromkeys(["npz", *self.write]))

    @property
    def at_once(self) -> tuple[str, ...]:
        """The fields that need all frames of a recording at once, however long it is."""
        needed = {
            "method": self.settings.method == "paper",
            "people": self.people is not None,
            "person": self.person != "consistent",
            "init": self.init is not None,
            "adjust_cameras": self.adjust_cameras,
            "fill_gaps": self.fill_gaps,
            "filter": self.filter is not None,
            "angles": self.angles,
            "write": "c3d" in self.write,
        }
        return tuple(option for option, given in needed.items() if given)


def _positive(option: str, value: float | None) -> None:
    if value is not None and not 0 < value < float("inf"):
        raise InvalidInputError(f"{option}: expected a positive number, got {value:g}")
