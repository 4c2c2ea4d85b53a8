"""The executables that are not nodes: simulate, track_bag, report, monte_carlo and the demo."""
