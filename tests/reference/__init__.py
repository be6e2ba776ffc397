"""Slow, plain NumPy twin of every kernel, in float64 and over full images.

It shares no code with the package: each module is written from DESIGN §§1–2 and the paper alone, so that
agreement between the two means something. Nothing here is clever, and nothing is fast.
"""
