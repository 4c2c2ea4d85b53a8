"""What is known of false detections: their rate, their amplitudes, and a map of their places."""
