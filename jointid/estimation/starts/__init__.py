"""Start values of the fits: by regression, at resonances, and with laws of the gears."""
