"""Poses over lines of JSON, in the form that ``live --help`` and docs/howto/live.md describe.

>>> session = Session(rig, layout, sk.RefineConfig(n_threads=1))  # doctest: +SKIP
>>> session.answer(b'{"frame": 7, "detections": [[[812.5, 400.1, 0.9], ...], ...]}')  # doctest: +SKIP
"""

from skelsplat.run.live._lines import MalformedLineError
from skelsplat.run.live._session import Session

__all__ = ["MalformedLineError", "Session"]
