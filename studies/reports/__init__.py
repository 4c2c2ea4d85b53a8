"""Studies of targets that report themselves."""
