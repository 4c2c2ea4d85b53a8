"""Recordings of the Autoferry dataset: a radar and a lidar on a ferry, and two vessels."""
