"""Gymnasium environments over packmech; empty until they are built."""
