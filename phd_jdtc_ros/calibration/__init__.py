"""What recordings say of the radars: their errors (registration) and parameters (tuning)."""
