"""The base class of sensors, reports, and the polar radar with its geometry, gates and coverage."""
