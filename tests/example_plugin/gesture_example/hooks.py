"""What this distribution brings. Only names and lazy targets: nothing heavy is imported here."""

from gesture_core import hookimpl


@hookimpl
def register_normalizers(register):
    register("hips", "gesture_example.hips:HipNormalizer", summary="mid-hip at the origin, hip width 1")


@hookimpl
def register_filters(register):
    register("speed", "gesture_example.speed:SpeedFilter", summary="adds how fast each joint moves")


@hookimpl
def register_distance_kernels(register):
    register("plain", "gesture_example.plain:PlainKernel", summary="pair by pair, for reading")


@hookimpl
def register_result_writers(register):
    register("markdown", "gesture_example.markdown:MarkdownWriter", summary="a Markdown table")
