"""Minimizers, the compiled program that they move, quenches, and batches of small packings."""
