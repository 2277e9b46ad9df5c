"""Mechanics: rigidity, Hessians, vibrations and elasticity of a packing, by sparse linear algebra."""
