"""``skelsplat app`` (extra ``app``): a local page in the browser for people who do not use a terminal.

The page fills in commands of `skelsplat.cli`, and a process of its own does each.
"""
