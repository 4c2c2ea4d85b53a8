"""Chosen limits of metrics and of the truth's interpolation."""

from __future__ import annotations

# Gaps longer than this are long. The value is that of ED-142 for en route, as in the evaluation
# tool COMPASS: two updates of 8 s with a margin.
LONG_GAP_S = 16.4
# Scans of an OSPA(2) window: one minute of a radar with a turn of 6 s.
OSPA2_WINDOW = 10
# An estimate this near to its target, metres, is good enough for air surveillance.
NEAR = 500.0
# Between samples of the truth that are further apart than this, seconds, it is not interpolated.
LONGEST_INTERPOLATION_S = 10.0
