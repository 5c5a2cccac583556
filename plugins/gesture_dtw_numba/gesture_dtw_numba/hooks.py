"""Registers the Numba distance kernel."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register(
        "numba",
        "gesture_dtw_numba.kernel:NumbaKernel",
        needs=("numba",),
        extra="numba",
        summary="batched warping distances on Numba",
    )
