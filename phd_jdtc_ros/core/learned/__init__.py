"""What is learned of a sensor while the tracker runs: its detection probability and its noise."""
