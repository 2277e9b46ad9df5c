"""Minimizers and protocols: what moves particles."""
