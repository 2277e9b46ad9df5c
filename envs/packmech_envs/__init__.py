"""Gymnasium environments over packmech: packings that are quenched until they jam, and sheared, step by step.

Importing this package registers ``"packmech/Quench-v0"`` and ``"packmech/Shear-v0"``, each with a twin that steps many
packings in one compiled call; ``gymnasium.make("packmech_envs:packmech/Shear-v0")`` imports it by itself.
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

# budgets are counted inside, in what an episode costs, so no TimeLimit is laid over them
gymnasium.register(
    id="packmech/Shear-v0",
    entry_point="packmech_envs.shear:ShearEnv",
    vector_entry_point="packmech_envs.shear_vector:ShearVectorEnv",
)
gymnasium.register(
    id="packmech/Quench-v0",
    entry_point="packmech_envs.quench:QuenchEnv",
    vector_entry_point="packmech_envs.quench_vector:QuenchVectorEnv",
)
