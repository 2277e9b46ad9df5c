"""Scenes as TOML files: how one is read and written, and those that ship with packmech."""
