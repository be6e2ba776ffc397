"""What runs find: cameras, joints and people to check, and unusual frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from skelsplat._optional import pip_line
from skelsplat._words import decimals, length, listed, number, options, percent

if TYPE_CHECKING:
    from skelsplat.findings import Finding

# Names and frame numbers that a sentence lists; the rest are counted.
_MOST_NAMES = _MOST_FRAMES = 6
# So many of a camera's detections are swapped if all are that have a side.
_ALL_SIDES = 0.6
# A direction is named from this part of the shift on.
_DIRECTION = 0.1


def _look(finding: Finding) -> str:
    """Return what looks for the cause: of a person of several, the command on their detections alone."""
    return f"{finding.numbers.get('check', 'skelsplat check-cameras')} looks for the cause"


def _leaves_out(finding: Finding) -> str:
    """Return "; --without a leaves it out", empty if that is no remedy."""
    without = [remedy for remedy in finding.remedy if remedy.setting == "without"]
    if not without:
        return ""
    return f"; {options(without)} leaves {'it' if len(without) == 1 else 'them'} out"


def _nothing_used(finding: Finding) -> str:
    cameras = finding.subject.cameras
    if cameras:
        only = f"only {listed(cameras)} {'has' if len(cameras) == 1 else 'have'} detections of people, and"
        return f"No detection could be used: {only} two cameras must detect them in the same frame."
    if finding.numbers.get("nobody"):
        return "No detection could be used: nobody is detected with enough confidence."
    if least := finding.numbers.get("min_confidence"):
        few = f"no joint has a confidence of {least:g} (--min-confidence) in two views"
        return f"No detection could be used: {few}."
    return "No detection could be used. Are they in pixels of these cameras' images (not 0 to 1), x before y?"


def _many_rejected(finding: Finding) -> str:
    mixed = any(remedy.setting == "person" for remedy in finding.remedy)
    first = "that all views show the same person (--person), then " if mixed else ""
    return (
        f"{percent(finding.numbers['rejected_share'])} of all detections are rejected: check {first}"
        "that calibration, cameras and detections belong together, and check timing, unit and layout."
    )


def _no_match(finding: Finding) -> str:
    counts = zip(finding.numbers["frames_without_match"], finding.numbers["frames_detected"], strict=True)
    frames = listed([f"{count:,} of {seen:,}" for count, seen in counts])
    one = len(finding.subject.cameras) == 1
    return (
        f"In {listed(finding.subject.cameras)}, no person detected matches the other cameras, in {frames} of "
        f"the frames in which {'it' if one else 'they'} and others detect a person: exchanged cameras, a "
        f"wrong calibration, unsynchronised video, or other people? {_look(finding)}{_leaves_out(finding)}."
    )


def _layout_of_file(finding: Finding) -> str:
    """Return what the skeleton of a file has, and which pairs its names state."""
    pairs, (file,) = finding.numbers["pairs"], finding.subject.files
    count = f"{len(pairs)} left–right pair{'' if len(pairs) == 1 else 's'} by name"
    limbs = f"{finding.numbers['limbs']} limbs" if finding.numbers["limbs"] else "no limbs"
    shown = f" ({', '.join(pairs[:_MOST_NAMES])}{', …' if len(pairs) > _MOST_NAMES else ''})" if pairs else ""
    return f"The layout is that of {file}: {finding.numbers['joints']} joints, {limbs}, {count}{shown}."


def _unused(finding: Finding) -> str:
    return (
        f"{finding.subject.cameras[0]} has no usable detections. Either the person is not in view, or its "
        "detections do not agree with the other views: --person chooses the person to follow"
        f"{_leaves_out(finding)}."
    )


def _disagrees(finding: Finding) -> str:
    numbers, compared = finding.numbers, finding.numbers["compared_with"]
    theirs = f"those of {', '.join(compared)}" if compared else "theirs"
    side = f"Its detections are shifted by {to_one_side(numbers)}. " if "shift_px" in numbers else ""
    return (
        f"{finding.subject.cameras[0]} disagrees with the other cameras: "
        f"{percent(numbers['rejected_share'])} of its detections are rejected, "
        f"{percent(numbers['others_rejected_share'])} of {theirs}, and its mean weight is "
        f"{numbers['mean_weight']:.2f}. {side}The pose follows the others: check this camera's calibration "
        f"and timing, and whether anything blocks its view. {_look(finding)}{_leaves_out(finding)}."
    )


def to_one_side(numbers: Mapping[str, Any]) -> str:
    """Return how far a camera's detections are shifted: "18 px from the pose (…); those of cam_01 by …"."""
    x, y = numbers["shift_px"]
    size = numbers["size_px"]
    words = ((x, "right" if x > 0 else "left"), (y, "down" if y > 0 else "up"))
    parts = [f"{abs(part):.0f} px {word}" for part, word in words if abs(part) >= _DIRECTION * size]
    error = numbers.get("median_error_px")
    with_error = "" if error is None else f", with a median error of {error:.1f} px"
    text = f"{size:.0f} px from the pose ({', '.join(parts)}){with_error}"
    return text + _also_displaced(numbers["also_displaced"])


def _also_displaced(others: list[dict[str, Any]]) -> str:
    if not others:
        return ""
    shifts = listed([f"those of {other['camera']} by {other['size_px']:.0f} px" for other in others])
    rivals = [other["camera"] for other in others if other["may_be_the_cause"]]
    may = f", so {listed(rivals, 'or')} may be the cause instead" if rivals else ""
    return f"; {shifts}{may}"


def _displaced(finding: Finding) -> str:
    name, numbers = finding.subject.cameras[0], finding.numbers
    where = to_one_side(numbers)
    if numbers["cameras"] == 2:
        return (
            f"The calibration or timing of one of the two cameras looks wrong: {name}'s detections "
            f"are shifted by {where}. It is impossible to tell which is wrong; {_look(finding)}."
        )
    other = ", or that of another of the three" if numbers["cameras"] == 3 else ""
    owner = f"{name}'s" if other else "its"
    return (
        f"{name}'s calibration or timing looks wrong{other}: {owner} detections are shifted by {where}. "
        f"{_look(finding)}{_leaves_out(finding)}."
    )


def _apart(finding: Finding) -> str:
    shares = zip(finding.subject.cameras, finding.numbers["share_of_frames"], strict=True)
    where = ", ".join(f"{name} in {percent(share)}" for name, share in shares)
    return (
        f"In {percent(finding.numbers['any_share_of_frames'])} of the frames, one camera's detections are "
        f"far from the whole pose ({where}). In these frames the cameras show different people or different "
        f"moments, or a calibration is wrong: inspect them. {_look(finding)}."
    )


def _mirrored(finding: Finding) -> str:
    share, name = finding.numbers["swapped_share"], finding.subject.cameras[0]
    confused = "Does the detector confuse the sides in this view?"
    cause = "Is the image mirrored?" if share >= _ALL_SIDES else confused
    return f"{name}: left and right are swapped in {percent(share)} of its detections. {cause}"


def _limbs_differ(finding: Finding) -> str:
    limbs = zip(finding.numbers["limbs"], finding.numbers["lengths_mm"], strict=True)
    sizes = " and ".join(f"{a} to {b} {length(size, 0, 10.0)} mm" for (a, b), size in limbs)
    others = " and ".join(finding.numbers["layouts_of_as_many_joints"])
    hint = f" ({others} has the same number of joints)" if others else ""
    return f"Left and right limbs differ in length, {sizes}. Is the layout correct{hint}?"


def _given_lengths_differ(finding: Finding) -> str:
    given, measured = finding.numbers["given_mm"], finding.numbers["measured_mm"]
    sizes = [
        f"{a} to {b} {length(size, 0, 10.0)} mm, measured {length(seen, 0, 10.0)} mm"
        for (a, b), size, seen in zip(finding.numbers["limbs"], given, measured, strict=True)
    ]
    return f"Given bone lengths contradict the recording, which follows them if it is short: {_some(sizes)}."


def _uncertain(finding: Finding) -> str:
    scatter = zip(finding.subject.joints, finding.numbers["scatter_mm"], strict=True)
    median = finding.numbers["median_scatter_mm"]
    joints = _some([f"{name} ({number(own, decimals(median, 0))} mm)" for name, own in scatter])
    return f"Scatter far above the median of {length(median, 0)} mm: {joints}."


def _some(joints: Sequence[str]) -> str:
    """Return the joints, the first of many and the number of the others."""
    more = len(joints) - _MOST_NAMES
    return ", ".join(joints) if more <= 1 else f"{', '.join(joints[:_MOST_NAMES])} and {more} more joints"


_STATUS = {
    "weak_joints": (
        "Weak joints",
        " (fewer than two views agree, or equally many agree on another position)",
        " They are written as usual; --fill-gaps N --fill-weak interpolates those between known frames.",
        " They are written as usual.",
    ),
    "joints_without_position": (
        "Weak joints",
        " without a position (detected in one view only, or in views from the same place)",
        " --fill-gaps N interpolates those between known frames.",
        "",
    ),
    "unobserved_joints": (
        "Unobserved joints",
        " (no usable detection; they keep their initial position, if any)",
        "",
        "",
    ),
}


def _status(finding: Finding) -> str:
    label, meaning, *remedies = _STATUS[finding.kind]
    named = finding.numbers["frames"]
    counts = finding.numbers.get("frames_in_all", map(len, named))  # of a long recording, more than are named
    frames = zip(finding.subject.joints, named, counts, strict=True)
    joints = _some([f"{joint} ({_frames(numbers, count)})" for joint, numbers, count in frames])
    if finding.numbers["filled"]:
        return f"{label}, now filled from neighbouring frames: {joints}."
    return f"{label}{meaning}: {joints}.{remedies[not finding.remedy]}"


def _frames(numbers: list[int], count: int | None = None) -> str:
    count = len(numbers) if count is None else count
    if count > _MOST_FRAMES:
        return f"{count} frames"
    return f"frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"


def _mixed(finding: Finding) -> str:
    numbers, person = finding.numbers, finding.numbers["person"]
    if "different_people_share" in numbers:
        fault = (
            f"the views show different people in {percent(numbers['different_people_share'])} of the frames"
        )
    else:
        steps = f"{numbers['changes']:,} of {numbers['steps']:,} steps from frame to frame"
        fault = f"it changes to another person in {steps}"
    entry = f"The order of people in a file is arbitrary: entry {person} is"
    why = "The largest in each image is" if person == "largest" else entry
    return (
        f"--person {person} mixes people: {fault}. {why} not always the same person; --person "
        f"consistent follows the person the views agree on, and --person {person} with --fps HZ one person."
    )


def _visible(finding: Finding) -> str:
    numbers = finding.numbers
    seen = (
        f"{numbers['people']} people are visible in about the same number of views in "
        f"{percent(numbers['share_of_frames'])} of the frames"
    )
    known = numbers.get("rate_known", False)
    if numbers["mixed"]:
        rate = "" if known else " with --fps HZ"
        return f"{seen}; --person consistent keeps to one of them, and --people all{rate} refines all."
    both = "--people all refines everybody, and --person chooses by number, size, motion or place"
    place = numbers.get("followed")
    where = f" (the one at {place[0]} in frame {place[1]})" if place else ""
    return f"{seen}. Check that the right one is followed{where}: {'' if known else 'with --fps HZ, '}{both}."


def _few_views(finding: Finding) -> str:
    counts = zip(finding.subject.cameras, finding.numbers["frames_seen"], strict=True)
    cameras = listed([f"{name} in {count:,}" for name, count in counts])
    seen = f"{cameras} of {finding.numbers['frames']:,} frames"
    return f"Mostly two views or fewer see this person ({seen}), so no third view confirms the pose."


def _over_people(finding: Finding) -> str:
    numbers, common = finding.numbers, finding.numbers["may_be_the_cause"]
    pairs = zip(finding.subject.cameras, numbers["named"], strict=True)
    whose = listed([f"{name} for {len(who)} ({_numbers(who)})" for name, who in pairs])
    if numbers["contradict"]:
        cause = f"; {listed(common, 'or')} may be the cause for all of them" if common else ""
        said = f"The people contradict each other about which is wrong{cause}."
    else:
        said = "A wrong calibration shows for every person in the camera's view, an obstructed view does not."
    return (
        f"Cameras that disagree with the others, over {numbers['people']} people: {whose}. {said} "
        f"{_look(finding)}{_leaves_out(finding)}."
    )


def _numbers(people: Sequence[int]) -> str:
    return f"person {people[0]}" if len(people) == 1 else f"people {listed([str(who) for who in people])}"


def _left_out(finding: Finding) -> str:
    shares = zip(finding.subject.cameras, finding.numbers["shares"], strict=True)
    cameras = ", ".join(f"{name} {percent(share)}" for name, share in shares)
    alike = " or ".join(finding.numbers["layouts_of_as_many_joints"])
    layout = f"a wrong layout ({alike} has the same number of joints)" if alike else "a wrong layout"
    finer = [remedy.text for remedy in finding.remedy if remedy.setting == "sigma_mm"]
    size = length(finding.numbers.get("size_mm", 0.0), 0)
    merged = [f"small bodies merged into one (those found are {size} mm long: try {one}), " for one in finer]
    return (
        f"{percent(finding.numbers['left_out_share'])} of the people detected are none of those found "
        f"({cameras}): {''.join(merged)}people whom one view sees, false detections, {layout}, or "
        f"cameras that do not fit. {_look(finding)}."
    )


def _jumps(finding: Finding) -> str:
    count, frames = finding.numbers["jumps"], _frames(list(finding.subject.frames))
    times = "once" if count == 1 else f"{count:,} times"
    longest = finding.numbers["longest_mm"]
    far = f"{longest / 1000:.1f} m" if longest >= 100 else f"{length(longest, 0, 10.0)} mm"
    return (
        f"The person jumps {times} from one frame to the next, by up to "
        f"{far} ({frames}): the detections change to another person, "
        "or frames are missing or out of order."
    )


def _followed(finding: Finding) -> str:
    numbers = finding.numbers
    if numbers["people"] == 1:
        return f"--person {numbers['person']} follows the only person found."
    return (
        f"--person {numbers['person']} follows person {numbers['identity']} of {numbers['people']} people, "
        "numbered from 0 in the order of appearance; --people all refines them all."
    )


def _lengths(finding: Finding) -> str:
    numbers, (a, b) = finding.numbers, finding.subject.joints
    low, high = numbers["range_mm"]
    digits = decimals(high, 0, 10.0)
    cause = (
        "The detections probably mix people: --person consistent follows the person the views agree on"
        if finding.remedy
        else "Either the views show different people, or most views are wrong about these joints: "
        f"{_look(finding)}"
    )
    return (
        f"Limb lengths vary by up to {percent(numbers['relative_range'])} over the recording, which is "
        f"impossible for one body. {a} to {b} is {number(low, digits)} to {number(high, digits)} mm long "
        f"(5th to 95th percentile), and {percent(numbers['off_share'])} of the lengths of arms and legs "
        f"deviate by more than scatter explains. {cause}."
    )


def named(finding: Finding) -> str:
    """Return the joints or cameras of a frame's finding; of many, their number."""
    names = finding.subject.joints or finding.subject.cameras
    return ", ".join(names) if len(names) <= _MOST_NAMES else f"{len(names)} of {finding.numbers['of']}"


def _at_once(finding: Finding) -> str:
    needed, numbers = finding.numbers["options"], finding.numbers
    verb, they = ("needs", "it") if len(needed) == 1 else ("need", "them")
    return (
        f"{listed(needed)} {verb} all {numbers['frames']:,} frames at once, at least "
        f"{numbers['gigabytes']:.1f} GB of memory; without {they} they are refined in parts."
    )


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "layout_of_file": _layout_of_file,
    "many_frames": "{frames:,} frames are read and drawn at once: --range A-B reads some of them.",
    "done_at_once": _at_once,
    "option_unused": "{option} has no effect: it applies to pose.trc and pose.c3d. --write lists neither.",
    "vertical_unknown": "--angles: the cameras do not show which axis of the world is vertical: "
    "trunk and pelvis are left out.",
    "times_assumed": lambda f: (
        f"--fps is not given: the times in {listed(f.subject.files)} assume {f.numbers['fps']:g} frames per "
        "second."
    ),
    "video_one_frame_late": "{files}: frames 0 to {last}, and the run has 1 to {last_of_run} of {cameras}: "
    "if its detector counts from 1, all is drawn one frame late; --first-frame 1 corrects that.",
    "nobody_detected": "{cameras}: no person detected in any frame ({frames} in all).",
    "videos_differ_in_length": (
        "The videos have different numbers of frames ({each}): if they begin at the same instant, refine "
        "needs --frames intersection."
    ),
    "videos_differ_in_rate": (
        "The videos have different frame rates ({each}): frames of the same number, which refine "
        "compares, are then not of the same instant."
    ),
    "video_turned": (
        "{files}: frames are turned by {degrees}° as the video's metadata say; the calibration must "
        "be of frames turned in the same way."
    ),
    "video_padded": "{files}: {size[0]}×{size[1]}, but the camera {cameras} has "
    "{size_of_camera[0]}×{size_of_camera[1]}: drawn without scaling.",
    "video_rate_assumed": "--fps is not given, and neither the images nor the run state it: assuming {fps:g} "
    "frames per second.",
    "video_frames_missing": "{files}: {missing} of the frames {first} to {last} of the run cannot be read or "
    "are not in it; {drawn} were drawn.",
    "no_figures": f"Figures need skelsplat[viz]: {pip_line('viz')}",
    "no_pictures": f"report.html and figures need skelsplat[viz]: {pip_line('viz')}",
    "nothing_used": _nothing_used,
    "many_rejected": _many_rejected,
    "further_than_start": "The refined pose lies further from the detections than its start (median "
    "{before_px:.1f} to {after_px:.1f} px): check the layout, the unit and the calibration.",
    "further_over_time": "Solved over time, the pose lies much further from the detections than frame by "
    "frame (median {before_px:.1f} to {after_px:.1f} px): check that the frames are in order and --fps is "
    "their rate; --frame-by-frame solves each frame alone.",
    "no_match": _no_match,
    "camera_unused": _unused,
    "camera_disagrees": _disagrees,
    "camera_displaced": _displaced,
    "views_apart": _apart,
    "camera_mirrored": _mirrored,
    "limbs_differ": _limbs_differ,
    "given_lengths_differ": _given_lengths_differ,
    "joints_rejected": lambda f: f"Most detections are rejected for {_some(f.subject.joints)}.",
    "joints_uncertain": _uncertain,
    **dict.fromkeys(_STATUS, _status),
    "people_mixed": _mixed,
    "people_visible": _visible,
    "cameras_over_people": _over_people,
    "people_left_out": _left_out,
    "person_of_few_views": _few_views,
    "person_still": "This person hardly moves: positions vary by {moved_mm:.0f} mm in {seconds:.0f} s. A "
    "poster, a dummy, or somebody who keeps still?",
    "person_mirrored": "This person is the mirror image of person {of}, within {apart_mm:.0f} mm: a "
    "reflection in a mirror or a window?",
    "person_back": "This may be person {before} again, who was last seen in frame {last}: their bones differ "
    "by {percent:.0f} %. Whoever is away for longer than five seconds, or cannot have got there, gets a new "
    "number.",
    "person_jumps": _jumps,
    "person_followed": _followed,
    "person_by_place": "--person {person} is entry {person} of each file, as the frame rate is unknown. The "
    "order of people in a file is arbitrary, so this need not be one person: with --fps HZ it is.",
    "person_of_files": "--person {person} is entry {person} of each file. The order of people in a file is "
    "arbitrary, so this need not be one person: without --person, everybody counts.",
    "limb_lengths_vary": _lengths,
    "frame_empty": "no detection could be used",
    "frame_diverged": "diverged",
    "frame_max_steps": "stopped at the step limit",
    "frame_unobserved": lambda f: f"unobserved: {named(f)}",
    "frame_inferred": lambda f: f"inferred: {named(f)}",
    "frame_weak": lambda f: f"weak: {named(f)}",
    "frame_filled": lambda f: f"filled over time: {named(f)}",
    "frame_swapped": lambda f: f"left–right swap in {named(f)}",
    "frame_rejected": lambda f: f"{max(f.numbers['percent']):.0f}% of the detections rejected",
    "frame_error": lambda f: f"median reprojection error {max(f.numbers['median_px']):.1f} px",
    "frame_scatter": lambda f: (
        f"scatter far above normal: {named(f)}, {length(max(f.numbers['scatter_mm']), 0)} mm"
    ),
}
