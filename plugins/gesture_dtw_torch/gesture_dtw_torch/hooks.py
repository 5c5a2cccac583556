"""Registers what is computed by Torch: a distance kernel and a classifier."""

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


@hookimpl
def register_classifiers(register: Register) -> None:
    register(
        "recurrent",
        "gesture_dtw_torch.recurrent:Recurrent",
        needs=("torch",),
        extra="torch",
        summary="the signals themselves, by gated recurrent units; for hundreds of examples",
    )
