"""Settings: defaults < TOML file < environment < flags, every key checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gesture_core.dtw.spec import BandMask
from gesture_core.errors import ConfigError
from gesture_core.plugin.interfaces import VideoLimits
from gesture_core.settings import LimitSettings, Settings, load_settings, presets, settings_from_dict
from gesture_core.settings.load import check_option
from gesture_core.skeletons import SKELETONS


def load(*sets: str, preset: str | Path | None = "paper", environment: dict[str, str] | None = None, **flags):  # type: ignore[no-untyped-def]
    return load_settings(preset, sets, environment=environment or {}, **flags)


@pytest.mark.parametrize("name", presets())
def test_every_preset_loads_and_survives_a_round_trip(name: str) -> None:
    settings = load(preset=name)
    assert settings_from_dict(settings.as_dict()).as_dict() == settings.as_dict()


def test_later_sources_win(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'base = "paper"\n[dtw]\nwindow = 0.1\n[classify]\nneighbors = 2\n[options.gaussian]\nsigma = 3.0\n'
    )
    assert load(preset=file).dtw.window == 0.1
    assert load(preset=file).options["variance"]["t_var"] == 0.10
    environment = {"GESTURE_SET_CLASSIFY__NEIGHBORS": "3", "GESTURE_SET_DTW__WINDOW": "5"}
    from_environment = load(preset=file, environment=environment)
    assert (from_environment.classify.neighbors, from_environment.dtw.window) == (3, 5)
    from_set = load("neighbors=4", preset=file, environment=environment)
    assert from_set.classify.neighbors == 4
    assert load("neighbors=4", preset=file, classify__neighbors=5).classify.neighbors == 5
    assert load("gaussian.sigma=2", preset=file).options["gaussian"]["sigma"] == 2


def test_values_are_read_by_the_type_of_the_setting() -> None:
    settings = load("window=none", "gamma=1", "filters=center, gaussian", "follow=true", "model=007")
    assert settings.dtw.window is None
    assert settings.dtw.gamma == 1.0
    assert settings.signals.filters == ("center", "gaussian")
    assert settings.pose.follow is True
    assert settings.pose.model == "007"
    assert load("t_var=0.2").options["variance"]["t_var"] == 0.2
    assert load("filters=").signals.filters == ()
    assert load("t_var=.2").options["variance"]["t_var"] == 0.2
    assert load("gamma=2.").dtw.gamma == 2.0
    assert load("spot.threshold=.5e-1").spot.threshold == 0.05
    assert isinstance(load("window=3").dtw.window, int)
    assert isinstance(load("window=0.5").dtw.window, float)


@pytest.mark.parametrize(
    ("setting", "hint"),
    [
        ("windw=1", "window"),
        ("dtw.windw=1", "window"),
        ("mode=sideways", "independent or dependent"),
        ("neighbors=2.5", "a whole number"),
        ("neighbors=many", "a whole number"),
        ("window=-1", "radius"),
        ("window=1.5", "fraction"),
        ("gamma=0", "positive"),
        ("reject=far", "a number"),
        ("nonsense", "key=value"),
        ("height=true", "a whole number"),
        ("dtw.weights=1", "a list of numbers"),
        ("filters=0", "a list of names"),
        ("dtw.mask=1", "a BandMask, from Python"),
    ],
)
def test_mistakes_are_named_with_a_remedy(setting: str, hint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(setting)
    assert hint in str(caught.value)


def test_a_mask_is_given_from_python_and_cannot_be_written_down() -> None:
    mask = BandMask.of(np.ones((3, 3), bool))
    settings = Settings().with_values([("dtw.mask", mask)])
    assert settings.dtw.mask == mask
    with pytest.raises(ConfigError, match=r"dtw\.mask cannot be written down"):
        settings.as_dict()


def test_wrong_files_are_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    for text, hint in (
        ("[dtw\n", "not TOML"),
        ("[dwt]\nwindow = 1\n", "did you mean dtw"),
        ("dtw = 1\n", "dtw is no table"),
        ("options = 1\n", "options is no table"),
        ("[options]\ngaussian = 1\n", r"try: \[options.gaussian\]"),
    ):
        file.write_text(text)
        with pytest.raises(ConfigError, match=hint):
            load(preset=file)
    with pytest.raises(ConfigError, match="paper"):
        load(preset=tmp_path / "absent.toml")


def test_defaults_are_frozen() -> None:
    with pytest.raises(AttributeError):
        Settings().pose.model = "other"  # type: ignore[misc]


def test_the_limits_of_a_video_are_those_of_the_settings() -> None:
    limits = LimitSettings()
    assert VideoLimits() == VideoLimits(limits.pixels, limits.frames)
    assert VideoLimits(7, 9) == VideoLimits(max_pixels=7, max_frames=9)


def test_an_option_of_another_preset_is_told_where_it_lives() -> None:
    with pytest.raises(ConfigError, match=r"'variance' in preset paper.*--preset paper"):
        load_settings("modern", ["t_var=0.1"])
    with pytest.raises(ConfigError, match=r"that preset modern does not set; try: gaussian\.sigma$"):
        load_settings("modern", ["sigma=2"])  # which has gaussian.seconds
    with pytest.raises(ConfigError, match=r"section\.name") as caught:
        load_settings("modern", ["qqqqqq=1"])
    assert len(caught.value.remedy) < 200
    with pytest.raises(ConfigError, match=r"nix\.toml: No such file"):
        load_settings("nix.toml")


def test_the_plugins_of_the_chain_are_one_list() -> None:
    assert load(preset="modern").plugins() == [
        ("normalizer", "torso"),
        ("selector", "moving"),
        ("filter", "gaussian"),
        ("filter", "resample"),
        ("filter", "parts"),
        ("filter", "parts:spot"),
        ("classifier", "blend"),
    ]
    twice = load("filters=gaussian,gaussian:wide", "kernel=numpy").plugins()
    filters = [("filter", "gaussian"), ("filter", "gaussian:wide")]
    assert twice[2:] == [*filters, ("kernel", "numpy"), ("classifier", "nearest")]


def test_an_option_of_a_plugin_that_takes_no_part_is_refused_by_those_who_ask() -> None:
    check_option("gaussian:wide.sigma", load("filters=gaussian:wide"), "--set")
    check_option("numpy.anything", load(), "--set")
    with pytest.raises(ConfigError, match=r"'gaussian:wide' takes no part.*signals\.filters=…,gaussian:wide"):
        check_option("gaussian:wide.sigma", load(), "--set")


@pytest.mark.parametrize(
    "text", ["1920x1080", "1920X1080", "1920×1080", "1920,1080", "[1920,1080]", "[1920, 1080]", "1920 x 1080"]
)
def test_a_frame_size_in_every_form(text: str) -> None:
    for key in ("keypoints.frame_size", "frame_size"):
        assert load(f"{key}={text}").keypoints.frame_size == (1920, 1080)
    assert load("frame_size=none").keypoints.frame_size is None


def test_an_order_is_a_skeleton_or_joints_in_any_spelling() -> None:
    assert load("keypoints.order=h36m17").keypoints.skeleton is SKELETONS["h36m17"]
    body = load("order=Nose,LShoulder,shoulder_r,tail").keypoints.skeleton
    assert body and body.joints == ("nose", "left_shoulder", "right_shoulder", "tail") and body.has_neck


@pytest.mark.parametrize(
    ("setting", "hint"),
    [
        ("keypoints.axes=zx", "xy or yx"),
        ("keypoints.unit=feet", "pixels or shares or metres"),
        ("keypoints.frame_size=1920", "1920x1080"),
        ("keypoints.frame_size=0x4", "1920x1080"),
        ("keypoints.fps=0", "frames a second"),
        ("keypoints.order=octopus", "coco17"),
        ("keypoints.order=left_wrist,right_wrist", "both shoulders"),
        ("keypoints.order=neck,LWrist,left_wrist", "left_wrist is there twice"),
        ("pose.fps=25", "keypoints.fps"),
        ("arrays.frame_size=1920x1080", "keypoints.frame_size"),
        ("csv.fps=25", "keypoints.fps"),
    ],
)
def test_what_keypoint_files_leave_open_is_checked(setting: str, hint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(setting)
    assert hint in str(caught.value)


def test_the_rate_of_an_old_run_is_kept() -> None:
    tree = load().as_dict()
    del tree["keypoints"]
    tree["pose"]["fps"] = 25.0
    assert settings_from_dict(tree).keypoints.fps == 25


def test_the_settings_of_an_old_run_mean_what_they_meant() -> None:
    tree = load().as_dict()
    del tree["spot"], tree["keypoints"]
    tree["pose"]["fps"] = 25.0
    assert settings_from_dict(tree).keypoints.fps == 25.0
    now = load("video.fps=20").as_dict()
    assert settings_from_dict(now).as_dict() == now
