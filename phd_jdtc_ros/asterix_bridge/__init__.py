"""What the node and the offline tool of the ASTERIX bridge share: settings, clouds and tracks."""
