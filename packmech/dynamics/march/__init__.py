"""The march: particles stepped through time in a box that may deform, with friction, bonds, walls and body forces."""
