"""``skelsplat app``: a local page in the browser for people who do not use a terminal.

The page fills in commands from the tables of `skelsplat.cli`, and a process of its own does each of them, so
that what it shows to be copied is what it has done. Python that the page needs is in the extra ``app``.
"""
