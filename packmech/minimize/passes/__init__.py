"""Compiled passes over pairs and particles, which programs and minimizers are made of."""
