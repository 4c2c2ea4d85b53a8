"""The live hand-over: the estimates of trackers that part an area, as one picture."""
