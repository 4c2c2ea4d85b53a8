"""What a radar measures of a state, where it sees, how it errs, and where it stands."""
