"""Faults while a tracker runs: restarts, too many scans, full disks, rogue peers, a long day."""
