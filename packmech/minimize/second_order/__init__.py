"""Newton's method, in a box as it is or with its strains among the unknowns, and the systems that it solves."""
