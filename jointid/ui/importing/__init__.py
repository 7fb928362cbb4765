"""Panels of the import page."""
