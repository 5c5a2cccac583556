"""Registers the Torch distance kernel."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register(
        "torch",
        "gesture_dtw_torch.kernel:TorchKernel",
        needs=("torch",),
        extra="torch",
        summary="batched warping distances on Torch",
    )
