"""`Estimates` and `Truth` as messages, each for another kind of consumer or viewer."""
