"""How a scene's stress answers to strain, and its strain to stress."""
