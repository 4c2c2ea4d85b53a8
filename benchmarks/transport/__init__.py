"""The cost around an engine: messages, DDS, ASTERIX, and the latency through all of these."""
