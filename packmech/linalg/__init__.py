"""Sparse linear algebra: factorizations with inertia, block systems, linear programs, Mandel components."""
