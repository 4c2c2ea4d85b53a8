"""From reports to scans: turning antennas, moving radars, stamps, and reports that come late."""
