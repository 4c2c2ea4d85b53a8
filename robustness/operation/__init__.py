"""Faults while nodes run: restarts, many scans, full disks, files of users, a rogue, a long day."""
