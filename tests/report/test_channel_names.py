"""Channels in pictures: their names in full, their units, and up is up."""

from __future__ import annotations

import numpy as np
import pytest

from gesture_core.report.channel_names import ChannelNames
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence


@pytest.mark.parametrize(
    ("preset", "spotted", "channel", "words", "unit"),
    [
        ("modern", False, "left_wrist_y.velocity", "left wrist: velocity upwards", "trunk lengths a second"),
        ("modern", False, "hands_x.energy", "hand to hand: speed sideways", "trunk lengths a second"),
        ("modern", False, "right_knee_y@1", "right knee: height about its mean", "trunk lengths"),
        ("modern", False, "right_forearm.turning", "right forearm: turning", "square trunk lengths a second"),
        ("modern", True, "right_shoulder_x", "right shoulder: sideways", "trunk lengths"),
        ("paper", False, "nose_y", "nose: height about its mean", "shoulder widths"),
        ("sensors", False, "acc/x.velocity", "acc/x.velocity", ""),
        ("modern", False, "something.else", "something.else", ""),
    ],
)
def test_a_channel_has_a_name_and_a_unit(
    preset: str, spotted: bool, channel: str, words: str, unit: str
) -> None:
    name = ChannelNames(load_settings(preset, environment={}), spotted)(channel)
    assert (name.words, name.unit) == (words, unit)


def test_values_are_in_their_unit_whatever_the_channel_weighs() -> None:
    """A wrist that rises by one trunk a second, for one second."""
    settings = load_settings("modern", environment={})
    times = np.arange(41) / 20
    risen = np.clip(times - 0.5, 0, 1)
    places = {"neck": (0, 0), "right_shoulder": (-40, 0), "left_shoulder": (40, 0), "right_hip": (-30, 100)}
    places |= {"left_hip": (30, 100), "right_elbow": (-60, 50), "left_elbow": (60, 50), "nose": (0, -40)}
    places |= {"left_wrist": (60, 90), "right_knee": (-30, 150), "left_knee": (30, 150)}
    from gesture_core.skeletons import COCO18

    points = np.full((41, 18, 2), np.nan, np.float32)
    for joint, place in places.items():
        points[:, COCO18.index(joint)] = place
    points[:, COCO18.index("right_wrist")] = np.stack([np.full(41, -60), 90 - 100 * risen], axis=1)
    signals = Chain.from_settings(settings)(PoseSequence(points, np.ones((41, 18)), times))
    channel = signals.channels.index("right_wrist_y.velocity")
    name = ChannelNames(settings)(signals.channels[channel])
    assert (name.factor * signals.values[:, channel]).max() == pytest.approx(1.0, abs=0.1)
