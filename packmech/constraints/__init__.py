"""Rigid links: Jacobian, bases, factorization, projection, the way back to their lengths, redundancy, RATTLE."""
