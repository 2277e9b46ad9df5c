"""Figures of results: `pm.plot`."""
