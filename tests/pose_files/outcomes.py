"""What a reader makes of a keypoint file of unknown health."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from frames import frame_name
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.errors import KeypointError

SECONDS = 2.0


def check(reader: Any, path: Path) -> str:
    """Read ``path`` in full: its sequences are sound, or a typed error says why not, within 2 s."""
    started = time.process_time()
    outcome = _outcome(reader, path)
    assert time.process_time() - started < SECONDS
    return outcome


def _outcome(reader: Any, path: Path) -> str:
    try:
        if not reader.accepts(path) and not path.is_dir():
            reader.read(path)
        found = [one for member in reader.members(path)[:3] for one in reader.read(path, member)]
    except KeypointError as error:
        assert error.code.startswith("E_KEYPOINTS_"), error
        assert error.subject
        str(error).encode()
        return error.code
    for sequence in found:
        assert len(sequence) and np.isfinite(sequence.times).all()
        assert not np.isinf(sequence.keypoints).any()
        assert (sequence.scores >= 0).all() and (sequence.scores <= 1).all()
    return "ok"


def check_frame(folder: Path, data: bytes) -> str:
    (folder / frame_name("f", 0)).write_bytes(data)
    return check(OpenPoseJsonReader(), folder)
