"""One whole run as a library: files in; poses, findings, a report, figures and files out.

It raises and returns, and never prints.
"""

from skelsplat.run._run import Run, run
from skelsplat.run.job import IncompleteJobError, Job
from skelsplat.run.over_time import Butterworth, OneEuro
from skelsplat.run.several import PeopleRun, run_people

__all__ = ["Butterworth", "IncompleteJobError", "Job", "OneEuro", "PeopleRun", "Run", "run", "run_people"]
