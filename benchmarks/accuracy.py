"""Compare the accuracy of the solver with baselines; every subcommand prints one table.

Run ``python benchmarks/accuracy.py table [--poses 300] [--seed 0] [--fast]``, or another.
"""

from __future__ import annotations

import lab
from measures.bars import angles, bias, coverage, coverage_human36m, coverage_real, gaussian
from measures.errors import bones, swaps, table
from measures.real import leave_one_out, mvor, mvor_people

MEASURES = (
    *(table, bones, swaps, gaussian, coverage, coverage_real, angles, mvor, mvor_people),
    *(coverage_human36m, bias, leave_one_out),
)

if __name__ == "__main__":
    lab.main(__doc__, *MEASURES)
