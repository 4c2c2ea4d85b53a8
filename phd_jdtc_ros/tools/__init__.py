"""The executables that are no nodes: simulate, track a bag, report, run the demo."""
