"""What a tracker publishes: `outputs` is the table; the others encode what is not of one target."""
