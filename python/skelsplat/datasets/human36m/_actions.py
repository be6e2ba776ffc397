"""Actions of Human3.6M, and the ways in which tools spell them."""

from __future__ import annotations

import re

ACTIONS = (
    "Directions",
    "Discussion",
    "Eating",
    "Greeting",
    "Phoning",
    "Photo",
    "Posing",
    "Purchases",
    "Sitting",
    "SittingDown",
    "Smoking",
    "Waiting",
    "WalkDog",
    "Walking",
    "WalkTogether",
)
"""In the order of the tables."""

NUMBERED = {
    2: "Directions",
    3: "Discussion",
    4: "Eating",
    5: "Greeting",
    6: "Phoning",
    7: "Posing",
    8: "Purchases",
    9: "Sitting",
    10: "SittingDown",
    11: "Smoking",
    12: "Photo",
    13: "Waiting",
    14: "Walking",
    15: "WalkDog",
    16: "WalkTogether",
}
"""Action by the number in file names such as ``s_09_act_05_subact_02``."""

ALIASES = {"TakingPhoto": "Photo", "WalkingDog": "WalkDog", "WalkingTogether": "WalkTogether"}


def action_of(activity: str) -> str:
    """Return the action of a take: ``"TakingPhoto 1"`` → ``"Photo"``."""
    stem = re.sub(r"[\s_-]*\d*$", "", activity.strip())
    return ALIASES.get(stem, stem)


def spelling(activity: str) -> str:
    """Return what all spellings of a take's name have in common: ``"WalkingDog_1"`` → ``"walkdog 1"``.

    ``"Greeting 1"`` (the name of the original file) and ``"Greeting-1"`` (its number among the two takes of
    an action) stay different: they can mean different takes.
    """
    number = re.search(r"([\s_-]*)(\d+)$", activity.strip())
    if number is None:
        return action_of(activity).lower()
    return f"{action_of(activity).lower()}{'-' if '-' in number[1] else ' '}{number[2]}"


def order(activity: str) -> tuple[int, str]:
    """Sort key: actions in the tables' order, then by name."""
    action = action_of(activity)
    return ACTIONS.index(action) if action in ACTIONS else len(ACTIONS), spelling(activity)


def subject_order(subject: str) -> tuple[int, str]:
    """Sort key of ``"S9"`` before ``"S11"``."""
    digits = re.sub(r"\D", "", subject)
    return int(digits) if digits else 0, subject
