"""A run, of one person or of several: results, statistics, findings, report; and what it can write."""

from __future__ import annotations

import html
import importlib
import sys
import tempfile
import webbrowser
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, numbers
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding
from skelsplat.io import PoseData
from skelsplat.io._files import load_json
from skelsplat.io._run_files import REPORT, check_finished, check_people, folders_of_run
from skelsplat.io.run_folder import read_run
from skelsplat.run import folder as folders
from skelsplat.run.angles import angles_of
from skelsplat.run.findings import find_findings
from skelsplat.run.frames import FrameFacts, Usual, find_in_frames, joint_frames
from skelsplat.run.job import Job, Writing
from skelsplat.run.over_time import apply_over_time
from skelsplat.run.read import Inputs
from skelsplat.run.report import build_report
from skelsplat.run.solve import GIVEN_START, Outcome, poses_of
from skelsplat.run.summary import Statistics, summarise

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

    import numpy.typing as npt

    from skelsplat.io.run_folder import RunFolder
    from skelsplat.run.parts import Gathered

_ORDER = ("error", "warning", "note")
_FORMATS = ("npz", "csv", "trc")
Place: TypeAlias = "str | os.PathLike[str]"


@dataclass(frozen=True, repr=False)
class Run:
    """A refined sequence with its input, statistics, findings and report.

    `skelsplat.run.run` makes one from files, `from_arrays` from a result of `skelsplat.refine` or
    `refine_sequence`, and `open` from the folder of an earlier run. T frames, M cameras, N joints.
    """

    #: The poses as they are written: gaps filled and filtered, if the job asks for it.
    poses: PoseData
    #: What to check before trusting the run, errors first,
    findings: tuple[Finding, ...]
    #: and what is unusual in single frames; numbers that are lists have a value for each of them.
    frame_findings: tuple[Finding, ...]
    #: What ``report.json`` holds: settings, counts, errors, timing and the findings.
    report: dict[str, Any]
    #: Counts and errors as arrays.
    statistics: Statistics
    #: What the run started from, what the refinement returned, and what that is compared with.
    inputs: Inputs
    outcome: Outcome

    @property
    def result(self) -> sk.Refinement:
        """The refinement over T frames."""
        return self.outcome.result

    @property
    def cameras(self) -> sk.CameraRig:
        """The M cameras, without those that were left out."""
        return self.inputs.rig

    @property
    def layout(self) -> sk.Layout:
        """What the N joints are."""
        return self.inputs.layout

    @property
    def angles(self) -> sk.JointAngles:
        """The joint angles of `poses`; those against the vertical if the cameras show which axis is up."""
        return angles_of(self)

    @property
    def detections(self) -> Array:
        """The detections of the person followed (T, M, N, 3), pixels and confidence; NaN where missing."""
        return self.inputs.detections

    @property
    def frames(self) -> Index:
        """The frame numbers (T,)."""
        return self.inputs.frames

    @classmethod
    def open(cls, folder: Place) -> Run:
        """Read the folder that a run wrote: poses, errors and weights are those of the files.

        `DatasetError` if a file is missing or malformed, or the files do not belong to one run.
        """
        found = read_run(folder)
        try:
            return _opened(found)
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            path, expected = Path(folder) / REPORT, "the report of a run of this version of skelsplat"
            raise DatasetError(path, "content", expected, f"{type(error).__name__}: {error}") from error

    @classmethod
    def from_arrays(
        cls,
        result: sk.Refinement,
        cameras: sk.CameraRig | Sequence[sk.Camera],
        detections: npt.ArrayLike,
        layout: str | sk.Layout,
        *,
        frames: npt.ArrayLike | None = None,
        init_pose: npt.ArrayLike | None = None,
        config: sk.RefineConfig | None = None,
        fps: float | None = None,
    ) -> Run:
        """Return the run of a result of `skelsplat.refine` or `refine_sequence`, of one pose or of T frames.

        ``cameras``, ``detections``, ``init_pose`` and ``config`` are those that it was given, confidences as
        third channel of the detections (1 without). The layout names the joints; ``frames`` (T,) are numbered
        from 0 when left out; ``fps`` are frames per second. `InvalidInputError` if a shape does not fit.
        """
        if np.ndim(result.pose) == 2:
            names = [entry.name for entry in fields(sk.Refinement)]
            result = sk.Refinement(**{name: np.asarray(getattr(result, name))[None] for name in names})
        seen, shape = numbers(detections, "detections"), result.view_weights.shape
        seen = seen if seen.ndim == 4 else seen[None]
        if seen.shape[:-1] != shape or seen.shape[-1] not in (2, 3):
            raise InvalidInputError(f"detections: expected {shape} pixels like the result, got {seen.shape}")
        if seen.shape[-1] == 2:
            seen = np.concatenate([seen, np.ones((*shape, 1))], axis=-1)
        inputs = Inputs(
            cameras if isinstance(cameras, sk.CameraRig) else sk.CameraRig(list(cameras)),
            sk.layouts.get(layout) if isinstance(layout, str) else layout,
            seen,
            np.zeros(shape[:2], dtype=np.bool_),
            np.arange(shape[0]) if frames is None else np.asarray(frames, dtype=np.int64),
            init_pose=None if init_pose is None else result.init_pose,
            fps=fps,
        )
        return summed_up(inputs, Outcome.of(result, config or sk.RefineConfig(), inputs))

    def write_html(self, path: Place) -> None:
        """Write a page with all numbers, the findings and the sequence in 3D; it opens offline."""
        from skelsplat.run.html import write_html  # matplotlib takes long to load

        write_html(self, Path(path))

    def show(self) -> None:
        """Show the page of `write_html`: below the cell in a notebook, in the browser elsewhere."""
        path = Path(tempfile.mkdtemp(prefix="skelsplat-")) / "report.html"
        self.write_html(path)
        shell = sys.modules.get("IPython")
        if shell is None or getattr(shell.get_ipython(), "kernel", None) is None:
            webbrowser.open(path.as_uri())
            return
        page = html.escape(path.read_text(encoding="utf-8"))
        frame = f'<iframe srcdoc="{page}" width="100%" height="800" frameborder="0"></iframe>'
        notebook = importlib.import_module("IPython.display")
        notebook.display(notebook.HTML(f"<div>{frame}</div>"))  # IPython warns of HTML that is a frame

    def write_figures(self, folder: Place) -> list[str]:
        """Write ``overview.png`` and ``weights.png``; return their names."""
        with folders.output_folder(Path(folder)):
            from skelsplat.run.figures import write_figures  # matplotlib takes long to load

            return write_figures(self, Path(folder))

    def write(self, folder: Place, formats: Sequence[str] = _FORMATS, **options: Any) -> list[str]:
        """Write everything, as ``skelsplat refine`` does; return the names of the files.

        Files of an earlier run are removed first. The folder can be read by `open`, and drawn by
        ``skelsplat plot`` and ``skelsplat overlay``. ``formats`` are of `skelsplat.io.poses.POSE_FORMATS`,
        ``options`` are ``html``, ``y_up``, ``marker_names``, ``angles`` and ``opensim`` as of `Job`. Without
        a frame rate, formats that need one assume 30 frames per second.
        """
        writing = Writing(write=tuple(formats), **options)
        with folders.run_folder(Path(folder)):
            return [*folders.write_folder(self, Path(folder), writing).report["files"], REPORT]

    def __repr__(self) -> str:
        found = f"{len(self.findings) or 'no'} finding{'s' * (len(self.findings) != 1)}"
        size = f"{len(self.frames)} frames of {self.layout.n_joints} joints, {len(self.cameras)} cameras"
        return f"Run({size}, {found})"


@dataclass(frozen=True, repr=False)
class PeopleRun:
    """The runs of all people of a recording.

    `skelsplat.run.run_people` makes one from files, and `open` from the folder of an earlier one.
    """

    #: By identity, in the order of appearance. The ``frames`` of a run are those from the first to the last
    #: in which two views see the person.
    people: Mapping[int, Run]
    #: What concerns everybody, errors first; findings on one person are in their `Run`.
    findings: tuple[Finding, ...]
    #: What ``report.json`` holds; ``people`` has an entry per person, with the name of their ``folder``.
    report: dict[str, Any]

    @property
    def frames(self) -> Index:
        """The numbers of the frames in which somebody is there."""
        return np.unique(np.concatenate([run.frames for run in self.people.values()]))

    @classmethod
    def open(cls, folder: Place) -> PeopleRun:
        """Read the folder that ``skelsplat refine --people`` wrote; if it is none, `DatasetError`."""
        path = Path(folder)
        if not folders_of_run(path):
            raise DatasetError(path, REPORT, "the report of a run of several people", "none")
        report = load_json(path / REPORT, "the report of a run")
        check_finished(path / REPORT, report)
        check_people(path / REPORT)
        people = {entry["id"]: Run.open(path / entry["folder"]) for entry in report["people"]}
        return cls(people, tuple(map(Finding.from_dict, report["findings"])), report)

    def write(self, folder: Place, formats: Sequence[str] = _FORMATS, **options: Any) -> list[str]:
        """Write everything, as ``skelsplat refine --people`` does; return names of files and folders."""
        writing = Writing(write=tuple(formats), **options)
        with folders.run_folder(Path(folder)):
            report = folders.write_everybody(self, Path(folder), writing).report
        return [*report["files"], *report["folders"], REPORT]


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings, errors first."""
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.severity)))


def summed_up(
    inputs: Inputs,
    outcome: Outcome,
    job: Job | None = None,
    notes: Sequence[Finding] = (),
    gathered: Gathered | None = None,
) -> Run:
    """Return the run with statistics, findings and report; of a long one, ``gathered`` has all frames."""
    poses, over_time = apply_over_time(poses_of(inputs, outcome.result), job)
    statistics = summarise(inputs, outcome, poses.joint_status == "filled")
    facts = FrameFacts.of(inputs, outcome, statistics, poses.joint_status)
    if gathered is None:
        named, counts = joint_frames(inputs, outcome, poses.joint_status), dict[tuple[str, int], int]()
    else:
        named, counts = gathered.named, gathered.named_count
        statistics = statistics.with_counts_of(gathered.counts)
    of_cameras = [one for one in notes if one.kind == "unit_wrong" and one.subject.files]
    if any(one.kind == "unit_wrong" and one.remedy and one not in of_cameras for one in notes):
        notes = [one for one in notes if one not in of_cameras]  # a person says more
    told = [one.subject for one in notes if one.numbers.get("fault") == "sides_swapped"]
    found = find_findings(inputs, outcome, statistics, named, counts)
    found = [*notes, *(one for one in found if one.kind != "sides_swapped" or one.subject not in told)]
    every = [facts] if gathered is None else gathered.facts()
    names = inputs.layout.joints, inputs.rig.names
    in_frames, left_out = find_in_frames(every, Usual.of(facts, statistics), *names)
    remarks = {
        "findings": [finding.to_dict() for finding in in_order(found)],
        "frame_findings": [finding.to_dict() for finding in in_frames],
        **({"frame_findings_left_out": left_out} if left_out else {}),
        "over_time": over_time,
    }
    report = build_report(inputs, outcome, statistics, remarks)
    return Run(poses, in_order(found), tuple(in_frames), report, statistics, inputs, outcome)


def _opened(found: RunFolder) -> Run:
    """Return the run of a folder; a built-in error if its report is malformed."""
    report, poses, settings = found.report, found.poses, found.report["settings"]
    mapping = report["input"]["mapping"] or {}
    inputs = Inputs(
        found.rig,
        found.layout,
        found.detections,
        np.zeros(found.detections.shape[:2], dtype=np.bool_),
        poses.frames,
        init_pose=poses.init_pose if report["start"] == GIVEN_START and not len(poses.velocity) else None,
        lacking=frozenset(joint for joint, name in mapping.items() if name is None),
        fps=poses.frame_rate,
    )
    make = sk.RefineConfig.paper if settings["method"] == "paper" else sk.RefineConfig
    outcome = Outcome.of(_refinement(poses), make(**settings), inputs)
    outcome = replace(outcome, seconds=report["timing"]["refine_s"])
    errors = report["reprojection_error"]
    cameras, joints, (total,) = (
        [{key: np.nan if value is None else value for key, value in one.items()} for one in entries]
        for entries in (errors["cameras"], errors["joints"], [errors["all"]])
    )
    statistics = replace(summarise(inputs, outcome), cameras=cameras, joints=joints, total=total)
    told = [tuple(map(Finding.from_dict, report[key])) for key in ("findings", "frame_findings")]
    return Run(poses, told[0], told[1], report, statistics, inputs, outcome)


def _refinement(poses: PoseData) -> sk.Refinement:
    """Return the refinement that a pose file holds; what it does not hold is NaN or empty."""
    steps, kind = len(poses.pose), sk.SequenceRefinement if len(poses.velocity) else sk.Refinement
    held = {entry.name: getattr(poses, entry.name, None) for entry in fields(kind)}
    unknown = {name: np.full(steps, np.nan) for name in ("loss_render", "loss_symmetry")}
    parts: dict[str, Any] = {**held, **unknown, "loss_history": np.empty((steps, 0))}
    return kind(**parts)
