"""What a run is asked to do."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import KW_ONLY, MISSING, Field, dataclass, field, fields
from typing import Any

import skelsplat as sk
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.io._arrays import FRAME_RATES
from skelsplat.io.detections import FORMATS, Rates
from skelsplat.io.detections._frames import FRAME_MODES
from skelsplat.io.detections._joints import check_layout
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.io.poses._markers import MARKER_NAMES
from skelsplat.run.over_time import Filter, parse_filter
from skelsplat.run.person import check_person


class IncompleteJobError(InvalidInputError):
    """An option of a `Job` has no effect without another one: ``option``, ``requires``, names of fields."""

    def __init__(self, option: str, requires: str) -> None:
        super().__init__(f"{option}: requires {requires}")
        self.option, self.requires = option, requires


@dataclass(frozen=True)
class Writing:
    """What is written into a run's folder apart from its report, inputs and figures."""

    _: KW_ONLY
    #: The pose files to write, of `skelsplat.io.poses.POSE_FORMATS`; ``pose.npz`` is always written.
    write: tuple[str, ...] = ("npz", "csv", "trc")
    #: Write ``pose.trc`` and ``pose.c3d`` with y pointing up, for OpenSim, instead of z,
    y_up: bool = False
    #: and call the joints in them as one of `skelsplat.io.poses.MARKER_NAMES`.
    marker_names: str = MARKER_NAMES[0]
    #: Write the joint angles as well, `skelsplat.joint_angles`: ``angles.csv``, ``.npz`` and ``.mot``; of a
    #: person who walks also ``strides.csv``.
    angles: bool = False
    #: Write what OpenSim needs for inverse kinematics into ``opensim``, `skelsplat.io.poses.OPENSIM_FILES`.
    opensim: bool = False
    html: bool = True

    @property
    def pose_formats(self) -> tuple[str, ...]:
        """The pose files to write: npz, and those of ``write``, each once."""
        return tuple(dict.fromkeys(["npz", *self.write]))


@dataclass(frozen=True)
class Job(Writing):
    """One run: where the input is, how to read it, how to refine it, and what to write.

    `InvalidInputError` if an option has no such value, or lacks another that it requires; the message begins
    with its name.
    """

    #: The calibration file.
    calibration: str | os.PathLike[str]
    #: The folder or file of detections.
    detections: str | os.PathLike[str]
    _: KW_ONLY
    #: How to read the calibration, as for `skelsplat.io.read_calibration`; None: as the file states it.
    unit: str | None = None
    calibration_format: str | None = None
    camera_type: str | None = None
    subject: str | None = None
    size: tuple[int, int] | None = None
    binning: float | None = None
    #: How to read the detections, as for `skelsplat.io.read_detections`; so are those from ``frames`` to
    #: ``sequence``, and ``fps``.
    layout: str | os.PathLike[str] | sk.Layout | None = None
    #: ``"consistent"``: the person the views agree on. The others follow people over time, as
    #: `skelsplat.track`, and choose one: a number from 0, the identity; ``"largest"``: whoever is largest in
    #: the images; ``"moves-most"``; a point ``"cam01:640,360"``: whoever is there in the first frame in which
    #: that camera sees somebody. These need a frame rate, without which ``"largest"`` is the largest in each
    #: image; ``"entry:0"`` is the first in each file. Both need not be one person.
    person: str | int = "consistent"
    #: For `run_people`: ``"all"``, or a number: those whom the views see most. None: one person.
    people: str | int | None = None
    frames: str = "strict"
    format: str | None = None
    offsets: Mapping[str, float] = field(default_factory=dict)
    order: str | tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    mapping: Mapping[str, str | int | None] = field(default_factory=dict)
    sequence: str | None = None
    #: A pose file to start from; None for triangulation.
    init: str | os.PathLike[str] | None = None
    #: Standard deviation per axis of that pose in mm, if it is independent of the detections; None: it is
    #: only the start of the search.
    init_sigma_mm: float | None = None
    #: Settings of the method; None: the defaults of `skelsplat.RefineConfig`.
    config: sk.RefineConfig | None = None
    #: Frames per second of the recording, or by camera; None: as the files, or videos next to them, state it.
    fps: Rates = None
    #: First adjust the cameras that were turned or moved, by the person the views agree on
    #: (`skelsplat.adjust_cameras`); the cameras used are written to the folder of the results.
    adjust_cameras: bool = False
    #: Names of cameras that were moved; only these are adjusted then, instead of those found to be wrong.
    move: tuple[str, ...] = ()
    #: Solve each frame alone even if the frame rate is known, instead of all over time (`Outcome.sequence`).
    frame_by_frame: bool = False
    #: Longest gap to fill by cubic splines, in frames (0: none), and whether weak joints are gaps as well.
    fill_gaps: int = 0
    fill_weak: bool = False
    #: ``"butterworth[:HZ[:ORDER]]"``; it needs ``fps``. None: no filter.
    filter: str | None = None
    #: Folder for the results; None: nothing is written.
    output: str | os.PathLike[str] | None = None
    #: A sentence about the input, to be shown with its numbers.
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
        low, high = FRAME_RATES
        for rate in (one for one in self.rates if not low <= one <= high):
            raise InvalidInputError(f"fps: expected a number from 1e-3 to 1e6, got {rate:g}")
        one_of("marker_names", self.marker_names, MARKER_NAMES)
        for kind in self.write:
            one_of("write", kind, tuple(POSE_FORMATS))
        self._check_formats("y_up", self.y_up, {"y_up", "up"})
        self._check_formats("marker_names", self.marker_names != MARKER_NAMES[0], {"marker_names"})
        self._check_over_time()

    def _check_formats(self, option: str, given: bool, understood: set[str]) -> None:
        """Refuse an option of pose files where none that is written understands it."""
        fitting = [kind for kind, entry in POSE_FORMATS.items() if understood & {*entry.options}]
        if given and not {*fitting} & {*self.write}:
            expected = f"one of {', '.join(fitting)} in write="
            raise InvalidInputError(f"{option}: expected {expected}, got {', '.join(self.write)}")

    def _check_people(self) -> None:
        number = isinstance(self.people, int) and not isinstance(self.people, bool) and self.people >= 1
        if self.people not in (None, "all") and not number:
            raise InvalidInputError(f"people: expected all or a number of at least 1, got {self.people!r}")
        given = {"person": self.person != "consistent", "init": self.init is not None}
        for option in (name for name, value in given.items() if value and self.people is not None):
            raise InvalidInputError(f"{option}: cannot be combined with people=, which refines everybody")

    def _check_start(self) -> None:
        sigma = self.init_sigma_mm
        if sigma is None:
            return
        if not 0 < sigma < float("inf"):
            raise InvalidInputError(f"init_sigma_mm: expected a positive number, got {sigma:g}")
        if self.init is None:
            raise IncompleteJobError("init_sigma_mm", "init")
        if self.settings.method == "paper":
            why = "with the method paper, whose start is not an observation"
            raise InvalidInputError(f"init_sigma_mm: expected none {why}, got {sigma:g}")

    def _check_over_time(self) -> None:
        if self.fill_weak and not self.fill_gaps:
            raise IncompleteJobError("fill_weak", "fill_gaps")
        if self.low_pass is not None and self.fps is None:
            raise IncompleteJobError("filter", "fps")
        if self.move and not self.adjust_cameras:
            raise IncompleteJobError("move", "adjust_cameras")

    @property
    def settings(self) -> sk.RefineConfig:
        """The settings of the method."""
        return sk.RefineConfig() if self.config is None else self.config

    @property
    def rates(self) -> tuple[float, ...]:
        """The frame rates in ``fps``."""
        return rates_in(self.fps)

    @property
    def low_pass(self) -> Filter | None:
        """The name and numbers of the filter."""
        return None if self.filter is None else parse_filter(self.filter)

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
            "opensim": self.opensim,
            "write": "c3d" in self.write,
        }
        return tuple(option for option, given in needed.items() if given)

    @property
    def python(self) -> str:
        """The lines of Python that do the job."""
        function = "run" if self.people is None else "run_people"
        given = [repr(os.fspath(self.calibration)), repr(os.fspath(self.detections))]
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name not in ("calibration", "detections", "config") and value != _usual(one):
                text = os.fspath(value) if isinstance(value, os.PathLike) else value
                given.append(f"{one.name}={text!r}")
        paper = self.settings.method == "paper"
        usual = (sk.RefineConfig.paper() if paper else sk.RefineConfig()).to_dict()
        changed = [f"{name}={one!r}" for name, one in self.settings.to_dict().items() if usual[name] != one]
        if paper or changed:
            given.append(f"config=sk.RefineConfig{'.paper' if paper else ''}({', '.join(changed)})")
        lines = ["import skelsplat as sk"] if paper or changed else []
        lines += [
            f"from skelsplat.run import Job, {function}",
            "",
            f"found = {function}(Job({', '.join(given)}))",
        ]
        return "\n".join([*lines, "for finding in found.findings:", "    print(finding)"])


def rates_in(fps: Rates) -> tuple[float, ...]:
    """Return the frame rates that are given, of all cameras or by camera."""
    if isinstance(fps, Mapping):
        return tuple(fps.values())
    return () if fps is None else (fps,)


def _usual(one: Field[Any]) -> Any:
    """Return the default of a field."""
    return one.default if one.default_factory is MISSING else one.default_factory()
