"""Findings on the cameras over all people of a recording: one rig, judged by everybody it sees."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import skelsplat as sk
from skelsplat.findings import Finding, Remedy, Subject
from skelsplat.io._run_files import LAYOUT
from skelsplat.run._run import Run, in_order
from skelsplat.run.people_report import folder_of

if TYPE_CHECKING:
    from skelsplat.run.job import Job

# A camera that does not fit the others, and findings whose cause check-cameras looks for.
_DOUBTS = ("camera_disagrees", "camera_displaced")
_CHECKED = (*_DOUBTS, "no_match", "views_apart", "limb_lengths_vary")


def in_proportion(runs: Mapping[int, Run]) -> dict[int, Run]:
    """Turn into a note that a camera disagrees, unless it does for most of the people whom it sees.

    Who stands before whom makes any camera disagree about somebody; a wrong one does about everybody.
    """

    def disagrees(finding: Finding) -> bool:
        return finding.kind == "camera_disagrees"

    everyone = runs.values()
    named = Counter(one.subject.cameras[0] for run in everyone for one in run.findings if disagrees(one))
    seen = Counter(group.name for run in everyone for group in run.statistics.cameras if group.used)

    def calmed(_: int, finding: Finding) -> Finding:
        few = disagrees(finding) and 2 * named[finding.subject.cameras[0]] <= seen[finding.subject.cameras[0]]
        return replace(finding, severity="note") if few else finding

    return _changed(runs, calmed)


def with_checks(runs: Mapping[int, Run], job: Job) -> dict[int, Run]:
    """Name in the findings on cameras the command that checks them with the detections of that person."""
    if job.output is None:
        return dict(runs)

    def checked(identity: int, finding: Finding) -> Finding:
        if finding.kind not in _CHECKED:
            return finding
        return replace(finding, numbers={**finding.numbers, "check": _command(identity, runs[identity], job)})

    return _changed(runs, checked)


def find_over_people(runs: Mapping[int, Run]) -> Iterator[Finding]:
    """Yield one finding on the rig if cameras do not fit the others for some of several people."""
    named: dict[int, list[str]] = {}
    suspects: dict[int, set[str]] = {}
    commands = []
    for identity, run in runs.items():
        found = [one for one in run.findings if one.kind in _DOUBTS and one.severity != "note"]
        if found:
            named[identity] = [one.subject.cameras[0] for one in found]
            rivals = (other for one in found for other in one.numbers.get("also_displaced", ()))
            may = {other["camera"] for other in rivals if other["may_be_the_cause"]}
            suspects[identity] = may | set(named[identity])
            commands.append(found[0].numbers.get("check"))
    if not named or len(runs) < 2:
        return
    cameras = next(iter(runs.values())).cameras.names
    blamed = {name: [who for who, own in named.items() if name in own] for name in cameras}
    blamed = {name: who for name, who in blamed.items() if who}
    common = [name for name in cameras if all(name in own for own in suspects.values())]
    contradict = max(map(len, blamed.values())) < len(named)
    numbers = {
        "people": len(runs),
        "named": list(blamed.values()),
        "contradict": contradict,
        "may_be_the_cause": common,
        **({"check": commands[0]} if commands[0] else {}),
    }
    remove = len(common) == 1 and len(cameras) > 2 and not contradict
    remedy = (Remedy("without", common[0]),) if remove else ()
    yield Finding("cameras_over_people", "warning", Subject(cameras=tuple(blamed)), numbers, remedy)


def _changed(runs: Mapping[int, Run], change: Callable[[int, Finding], Finding]) -> dict[int, Run]:
    changed = {}
    for identity, run in runs.items():
        found = in_order(change(identity, finding) for finding in run.findings)
        report = {**run.report, "findings": [finding.to_dict() for finding in found]}
        changed[identity] = replace(run, findings=found, report=report)
    return changed


def _command(identity: int, run: Run, job: Job) -> str:
    """Return the command that checks the cameras with a person's detections alone."""
    folder = Path(str(job.output)) / folder_of(identity)
    special = (job.calibration_format, job.camera_type, job.subject, job.size, job.binning, job.without)
    words = ["skelsplat", "check-cameras"]
    if any(special) or job.adjust_cameras:  # the cameras as they were used
        words += [str(folder / "cameras.json"), str(folder / "detections.npz")]
    else:
        words += [str(job.calibration), str(folder / "detections.npz")]
        words += ["--unit", job.unit] if job.unit else []
    own = not sk.layouts.is_built_in(run.layout)
    return shlex.join([*words, "--layout", str(folder / LAYOUT) if own else run.layout.name])
