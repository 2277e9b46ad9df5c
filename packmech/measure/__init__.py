"""Measures of a scene or a packing as it stands; nothing here changes anything."""
