"""What every public call and record has: the effects that it honors, its progress, its repr, its help."""
