"""Starting packings: sizes, random positions, lattices."""
