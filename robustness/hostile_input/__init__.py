"""Input that is made to harm: bags, checkpoints, YAML, ASTERIX and random bytes."""
