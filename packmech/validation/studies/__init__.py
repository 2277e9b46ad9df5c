"""Studies that measure something over many packings, and in `accuracy` what accuracy costs in time."""
