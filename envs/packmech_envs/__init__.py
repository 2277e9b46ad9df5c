"""Gymnasium environments over packmech: packings that are quenched until they jam, and sheared, step by step.

Importing this package registers ``"packmech/Quench-v0"`` and ``"packmech/Shear-v0"``, each also as a batch that steps
many packings in one compiled call; ``gymnasium.make("packmech_envs:packmech/Shear-v0")`` imports it by itself.
"""

from __future__ import annotations

try:
    import gymnasium
except ModuleNotFoundError as missing:
    if missing.name != "gymnasium":
        raise
    raise ModuleNotFoundError(
        'packmech_envs needs gymnasium, which comes with the extra `envs`: pip install "packmech[envs]"',
        name="gymnasium",
    ) from missing

__all__: list[str] = []

# budgets are counted by the environments themselves, in what an episode costs, so there is no TimeLimit
for _name in ("Shear", "Quench"):
    gymnasium.register(
        id=f"packmech/{_name}-v0",
        entry_point=f"packmech_envs.single:{_name}Env",
        vector_entry_point=f"packmech_envs.batched:{_name}VectorEnv",
    )
