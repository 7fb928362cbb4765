"""Records of any motion: spectra, band, noise, velocities, end terms, and friction at pauses."""
