"""Settings, clouds and tracks of the ASTERIX bridge, shared by its node and its offline tool."""
