"""Panels of the fleet page."""
