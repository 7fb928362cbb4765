"""File formats of set points, one module each."""
