"""Newton's equations stepped through time, with friction, bonds, walls, body forces, links and boxes that deform."""
