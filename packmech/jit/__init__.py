"""Functions compiled by numba, their machine code on disk, and Ctrl-C while code is made."""
