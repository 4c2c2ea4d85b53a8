"""Models of targets: motions and their modes, births, spawning, and amplitudes."""
