"""One whole run as a library: files in; poses, findings, a report, figures and files out.

It raises and returns, and never prints.
"""

from skelsplat.run._run import PeopleRun, Run
from skelsplat.run.batch import Batch, Recording, run_batch
from skelsplat.run.engine import run, run_people
from skelsplat.run.job import IncompleteJobError, Job

__all__ = [
    "Batch",
    "IncompleteJobError",
    "Job",
    "PeopleRun",
    "Recording",
    "Run",
    "run",
    "run_batch",
    "run_people",
]
