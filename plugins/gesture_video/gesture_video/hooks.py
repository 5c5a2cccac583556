"""Registers the video readers."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_video_readers(register: Register) -> None:
    register(
        "pyav",
        "gesture_video.pyav:PyAvReader",
        needs=("av",),
        extra="video",
        summary="FFmpeg through PyAV: counts what is damaged or lost",
    )
    register(
        "opencv",
        "gesture_video.opencv:OpenCvReader",
        needs=("cv2",),
        summary="FFmpeg inside OpenCV: notices frames that are missing from a believable count",
    )
