"""The takes of the simulated Human3.6M-like sets: subjects, actions and how many poses each has.

The two subjects' totals (1253 and 928 poses), those of the takes that the absolute error leaves out (S9
"SittingDown 1" 25, "Waiting 1" 26, "Greeting" 23) and S11 "Directions" (29) are those of Human3.6M at every
64th frame; the other takes share the rest evenly.
"""

from __future__ import annotations

from typing import NamedTuple

SUBJECTS = {"S9": 1.02, "S11": 0.97}
"""Subject → body size, as a factor on the 1.75 m adult."""

# Action → the package's motion that stands in for it.
_MOTIONS = {
    "Directions": "reach",
    "Discussion": "wave",
    "Eating": "sit",
    "Greeting": "wave",
    "Phoning": "turn",
    "Photo": "reach",
    "Posing": "turn",
    "Purchases": "crouch",
    "Sitting": "sit",
    "SittingDown": "crouch",
    "Smoking": "sit",
    "Waiting": "turn",
    "WalkDog": "walk",
    "WalkTogether": "walk",
    "Walking": "walk",
}
_TOTALS = {"S9": 1253, "S11": 928}
_KNOWN = {
    ("S9", "SittingDown 1"): 25,
    ("S9", "Waiting 1"): 26,
    ("S9", "Greeting"): 23,
    ("S11", "Directions"): 29,
}


class HumanTake(NamedTuple):
    """A take: its name is the action, with `` 1`` behind it the second time."""

    subject: str
    name: str
    action: str
    motion: str
    poses: int


def _takes(subject: str) -> list[HumanTake]:
    names = [(action, f"{action}{number}") for action in _MOTIONS for number in ("", " 1")]
    known = {name: poses for (who, name), poses in _KNOWN.items() if who == subject}
    rest, n_rest = _TOTALS[subject] - sum(known.values()), len(names) - len(known)
    # The remainder of the division goes to the first takes, one pose each.
    shares = iter([rest // n_rest + (k < rest % n_rest) for k in range(n_rest)])
    return [
        HumanTake(subject, name, action, _MOTIONS[action], known[name] if name in known else next(shares))
        for action, name in names
    ]


TAKES: tuple[HumanTake, ...] = tuple(take for subject in SUBJECTS for take in _takes(subject))
