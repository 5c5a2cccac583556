"""Registers the execution engine."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_engines(register: Register) -> None:
    register(
        "ray",
        "gesture_engine_ray.engine:RayEngine",
        needs=("ray",),
        extra="ray",
        summary="the machines of a Ray cluster",
    )
