"""Minimizers, and the compiled program that they move."""
