"""Records of any motion: spectra, band, noise, velocities, and what their ends and pauses hide."""
