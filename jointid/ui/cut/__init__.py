"""Panels of the page about the cut."""
