"""The cost of an engine: its steps and their parts, its smoother, growth, and other trackers."""
