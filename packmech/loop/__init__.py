"""One run loop and one checkpoint file for everything that is stepped."""
