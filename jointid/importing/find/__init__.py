"""Steady sine segments in long logs."""
