"""Names of the models that come with the package, for help and completion: loading their equations takes a while."""

MODEL_NAMES = (
    *("single_track", "lateral", "longitudinal", "kinematic"),
    *("msnn_lat", "msnn_long", "msnn_full"),
    *("gnn", "msnn_bench_lat", "msnn_bench_long"),
    *("hybrid_stiffness", "hybrid_force"),
    *("mlp_lateral", "bicycle_mlp"),
    "msnn_full_plus",
)
"""The keys of `registry.MODELS`, in its order."""
