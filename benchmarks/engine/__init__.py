"""The cost of an engine: its steps and their parts, growth, late reports, and other trackers."""
