"""Packings, scenes and tables as files."""
