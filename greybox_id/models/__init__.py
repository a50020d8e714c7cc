"""Vehicle models and the effects that they may lack. Models hold no data and no solver."""

from __future__ import annotations

MODEL_NAMES = (
    *("single_track", "lateral", "longitudinal", "kinematic", "steering"),
    *("msnn_lat", "msnn_long", "msnn_full"),
    *("gnn", "msnn_bench_lat", "msnn_bench_long"),
    *("hybrid_stiffness", "hybrid_force"),
    *("mlp_lateral", "bicycle_mlp"),
    "msnn_full_plus",
)
"""The keys of `registry.MODELS`, in its order."""
