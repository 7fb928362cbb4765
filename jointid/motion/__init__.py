"""Records of any motion: their spectra, band, noise and velocities."""
