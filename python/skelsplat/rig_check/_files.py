"""Whether the detections of all cameras are of other images, or of one another's, or both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skelsplat.rig_check._images import find_images
from skelsplat.rig_check._people import ALL_ORDERS, CLEAR, find_exchange, judge, some_frames

if TYPE_CHECKING:
    from collections.abc import Sequence

    import skelsplat as sk
    from skelsplat.rig_check._findings import Finding
    from skelsplat.rig_check._scene import Array

# In a ring of cameras mirrored images and cameras exchanged across leave the same; noise decides nothing.
_ALIKE = 1.05


@dataclass(frozen=True)
class Mended:
    """What was found, the people (T, M, P, N, 2) with it set right, and how far the cameras are off then.

    The error is in pixels of the detections as they were given: small images make small errors. It is
    infinite where nothing is compared with it.
    """

    findings: tuple[Finding, ...]
    people: Array
    error_px: float = float("inf")


def mend_files(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Mended:
    """Find other images and exchanged cameras, and set right what leaves less disagreement.

    Exchanged cameras may agree better by chance if the images are taken to be of another size, and in a
    symmetric rig they look nearly like turned or mirrored images. So an exchange alone is tried beside the
    images, and what fits nearly as well is mentioned. Not so with more cameras than all orders are tried of:
    the exchange of two of them looks like nothing else.
    """
    images, upright, factor = find_images(cameras, people, layout)
    exchange, order = find_exchange(cameras, upright, layout)
    findings = tuple(finding for finding in (images, exchange) if finding is not None)
    mended = upright[:, list(order)]
    if images is None or len(cameras) > ALL_ORDERS:
        return Mended(findings, mended)
    exchange, order = find_exchange(cameras, people, layout)
    if exchange is None:
        return Mended(findings, mended)
    error = judge(cameras, mended[some_frames(len(people))], layout).disagreement / factor
    alone = Mended((exchange,), people[:, list(order)], exchange.numbers["after_px"])
    return _better(Mended(findings, mended, error), alone)


def _better(images: Mended, exchange: Mended) -> Mended:
    """Return what leaves less, images where both leave as much; the other is mentioned if it is near."""
    pair = (images, exchange) if images.error_px <= _ALIKE * exchange.error_px else (exchange, images)
    best, rival = pair
    if rival.error_px >= CLEAR * best.error_px:
        return best
    first, *rest = best.findings
    text = f"{first.text} That {' and that '.join(map(_cause, rival.findings))} would fit almost as well."
    return replace(best, findings=(replace(first, text=text), *rest))


def _cause(finding: Finding) -> str:
    """Return a finding without its pixels, to stand in a sentence."""
    cause = finding.text.partition(" px off what the others say")[0].rpartition(": ")[0]
    return cause[0].lower() + cause[1:]
