"""Panels of the pages about one study."""
