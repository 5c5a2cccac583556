"""Registers the NumPy distance kernel and the approximation of Salvador and Chan."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register("numpy", "gesture_dtw_numpy.kernel:NumpyKernel", summary="NumPy, runs anywhere")
    register(
        "fastdtw",
        "gesture_dtw_numpy.fastdtw:FastDtwKernel",
        summary="the approximation of Salvador and Chan, slow",
    )
