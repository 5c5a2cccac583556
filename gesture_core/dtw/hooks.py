"""Registers the reference kernel and its vectorised fallback."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register("numpy", "gesture_core.dtw.vectorised:NumpyKernel", summary="NumPy, runs anywhere")
    register(
        "fastdtw",
        "gesture_core.dtw.fastdtw:FastDtwKernel",
        summary="the approximation of Salvador and Chan, slow",
    )
