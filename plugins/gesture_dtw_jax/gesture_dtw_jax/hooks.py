"""Registers the Jax distance kernel."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register(
        "jax",
        "gesture_dtw_jax.kernel:JaxKernel",
        needs=("jax",),
        summary="batched warping distances on Jax",
    )
