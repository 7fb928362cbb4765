"""A table of named columns: its values, units and the meaning of names."""
