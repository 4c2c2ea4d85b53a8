"""The protocol of a sensor, reports, and the polar radar: geometry, gates, coverage, biases, sites."""
