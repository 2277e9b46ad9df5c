"""Protocols: what is done to a packing until it is jammed, compressed, stabilized or cemented."""
