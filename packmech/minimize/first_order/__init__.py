"""Minimizers that see forces only, one file each."""
