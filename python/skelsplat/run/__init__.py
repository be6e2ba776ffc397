"""One whole run as a library: files in; poses, findings, a report, figures and files out.

It raises and returns, and never prints.
"""

from skelsplat.run._run import Run, run
from skelsplat.run.batch import Batch, Recording, run_batch
from skelsplat.run.job import IncompleteJobError, Job
from skelsplat.run.long import run_long
from skelsplat.run.over_time import Butterworth, OneEuro
from skelsplat.run.several import PeopleRun, run_people

__all__ = [
    "Batch",
    "Butterworth",
    "IncompleteJobError",
    "Job",
    "OneEuro",
    "PeopleRun",
    "Recording",
    "Run",
    "run",
    "run_batch",
    "run_long",
    "run_people",
]
