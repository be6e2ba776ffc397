"""Names of files, cameras and joints reach the terminal as they are: no control character, no markup."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import invoke
from skelsplat import synthetic
from skelsplat._escape import CONTROL
from skelsplat.cameras import altered
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import FindingWarning, remark
from skelsplat.io import write_calibration
from skelsplat.run import folder as folders

# a window's title and markup, the screen cleared in eight bits, a line of its own, a direction, an emoji
CAMERAS = ["\x1b]0;x\x07[red]x[/red]", "a\x9b2Jb", "c\nerror: none", "\u202e:warning:\x7f"]
JOINTS = ["\x1b[31mhead", "b\x9bc", "[bold]d[/bold]\r", "left_\u2028e", "right_\u2028e", "f\tg"]
NAMED = "o\x1b[31m[blue]\u202et"
T = 4


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Return a folder of files with such names in them, and a run of them."""
    top = tmp_path_factory.mktemp("names") / NAMED
    top.mkdir()
    cameras = [altered(one, name=name) for one, name in zip(synthetic.human36m_like(), CAMERAS, strict=True)]
    rig = sk.CameraRig(cameras, "mm")
    write_calibration(top / "rig.json", rig)
    sk.layouts.write(top / "own.toml", sk.layouts.from_names("lay\x1bout", JOINTS, [(0, 1), (2, 3), (2, 4)]))
    pose = synthetic.motion("walk", T, seed=3)[:, :6]
    seen = sk.project(pose, rig).swapaxes(0, 1)
    seen[:, 1, :, 0] += 60  # a camera that the others contradict
    names = {"camera_names": np.array(CAMERAS), "joint_names": np.array(JOINTS), "frames": np.arange(T)}
    np.savez(
        top / "seen.npz", detections=np.concatenate([seen, np.full((*seen.shape[:-1], 1), 0.9)], -1), **names
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folders, "can_draw", lambda: False)
        run = invoke("refine", *read(top), "-o", top / "out", "--fps", 50, "--write", "csv")
    assert run.exit_code == 0, run.output
    return top, run


def read(top):
    return [top / "rig.json", top / "seen.npz", "--layout", top / "own.toml"]


def shown(result, *parts, status=0):
    """Assert what is on the terminal: these parts, none of the control characters but ends of lines."""
    assert result.exit_code == status, result.output
    text = result.stdout + result.stderr
    assert set(CONTROL.findall(text)) <= {"\n"}
    for part in parts:
        assert part in text.replace("\n", ""), (part, text)
    return text


ESCAPED = [r"\x1b]0;x\x07[red]x[/red]", r"a\x9b2Jb", r"c\nerror: none", r"\u202e:warning:\x7f"]


def test_a_run_prints_names_as_they_are(given):
    text = shown(given[1], *ESCAPED, r"\x1b[31mhead", "[bold]d[/bold]", r"o\x1b[31m[blue]\u202et/out/")
    assert not [line for line in text.splitlines() if line.startswith("error: ")]


COMMANDS = {
    "check-cameras": (lambda top: read(top), ESCAPED, (0, 1)),
    "adjust-cameras": (lambda top: [*read(top), "-o", top / "new.toml", "--force"], ESCAPED, (0, 1)),
    "convert": (
        lambda top: [top / "rig.json", top / "new.json", "--force"],
        [*ESCAPED[:2], r"\x1b[31m"],
        (0,),
    ),
    "overlay": (lambda top: [top / "out", "--plain", "--png", "--range", "0-0"], [r"\x1b[31m[blue]"], (0,)),
}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.filterwarnings("ignore:Glyph")
def test_no_command_obeys_names(given, name):
    top = given[0]
    arguments, parts, status = COMMANDS[name]
    result = invoke(name, *arguments(top))
    assert result.exit_code in status, result.output
    shown(result, *parts, status=result.exit_code)
    result = invoke(name, *arguments(top), "--json")
    json.loads(shown(result, status=result.exit_code).partition("warning: ")[0])
    result = invoke(name, *arguments(top), "--quiet")
    shown(result, status=result.exit_code)


def test_errors_and_warnings_of_the_library_are_one_line_of_text():
    assert (
        str(DatasetError("a\x1b[31m", "b", "c\x9b", "d\u202e"))
        == r"a\x1b[31m: b: expected c\x9b, got d\u202e"
    )
    error = InvalidInputError("name: expected x, got \x1b[31m\n")
    assert str(error) == r"name: expected x, got \x1b[31m\n"
    with pytest.raises(InvalidInputError, match=r"expected one of .*, got 'h\\x1b\[31m'"):
        sk.layouts.get("h\x1b[31m")
    finding = remark("of \x1b]0;t\x07")
    assert finding.text == str(FindingWarning(finding)) == r"of \x1b]0;t\x07"
