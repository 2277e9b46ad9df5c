"""Studies of accuracy, time and memory."""
