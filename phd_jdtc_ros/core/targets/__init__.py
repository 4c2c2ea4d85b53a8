"""What targets do: motions and their modes, births, spawning, and how strong their echoes are."""
