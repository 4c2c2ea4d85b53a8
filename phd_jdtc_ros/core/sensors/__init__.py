"""The protocol of a sensor, reports, and the polar radar with its geometry, gates and coverage."""
