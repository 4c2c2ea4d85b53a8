"""The executables that are no nodes: simulate, track a bag, report, a study, and the demo."""
