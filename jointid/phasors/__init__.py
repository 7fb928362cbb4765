"""From records to phasors, equations (2)-(4): the sine fit, its noise, long records, sensor steps."""
