"""Joins the estimates of several trackers into one picture, with one number for each target."""
