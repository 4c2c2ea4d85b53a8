"""The ASTERIX bridge: radars' UDP to clouds, estimates to UDP."""
