"""The measurement update of Gaussians: gates, pairs, linearisation, amplitudes and births."""
