"""Scenes in which a result was once wrong without a word."""
