"""From phasors to K and D, equations (8)-(15) and beyond."""
