"""The bridge of reports: its parameters, for the node and the offline tool, and its clouds."""
