"""Shear at rest: families at zero pressure, quasistatic shear, shear jamming and stabilization."""
