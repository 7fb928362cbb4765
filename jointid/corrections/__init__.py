"""Corrections of a study, as findings of the verdict propose them."""
