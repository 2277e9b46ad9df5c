"""Accuracy against time on a problem of one's own, and the reference model."""
