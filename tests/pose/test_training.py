"""The training of the own network, on pictures so small and few that it takes seconds."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

for _module in ("torch", "onnx", "onnxruntime", "cv2", "rich", "scipy"):
    pytest.importorskip(_module, reason=f"the training needs {_module}: pip install 'gesture-core[train]'")

import torch  # noqa: E402

from gesture_core.errors import ConfigError, ModelError  # noqa: E402
from training import (  # noqa: E402
    augment,
    decode,
    evaluate,
    export,
    joints,
    label,
    legs,
    losses,
    network,
    show,
    skirts,
    swing,
)
from training import settings as settings_module  # noqa: E402
from training.batches import Batches, leg_of  # noqa: E402
from training.cutout import PERSON, cut_out  # noqa: E402
from training.grow import grow  # noqa: E402
from training.store import Store, Writer  # noqa: E402
from training.train import finished, train  # noqa: E402

TINY = {
    "seed": 3,
    "threads": 1,
    "checkpoint_steps": 2,
    "network": {"widths": [4, 4, 8, 8, 8], "depths": [1, 1, 1, 1], "expand": 2, "neck": 8},
    "schedule": [{"steps": 2, "size": 64, "batch": 4}, {"steps": 2, "size": 96, "batch": 4, "offset": 0.1}],
}

STANDING = np.array(
    [[48, 16], [48, 28], [38, 28], [34, 40], [32, 50], [58, 28], [62, 40], [64, 50], [42, 54], [42, 70],
     [42, 86], [54, 54], [54, 70], [54, 86], [46, 14], [50, 14], [43, 15], [53, 15]], np.float64
)  # fmt: skip


def _store(folder: Path, rendered: bool, count: int = 5) -> Store:
    rng = np.random.default_rng(0)
    writer = Writer(folder, 96, capacity=8)
    for index in range(count):
        picture = rng.integers(0, 256, (96, 96, 3), dtype=np.uint8)
        mask = np.full((96, 96), 0 if rendered else 128, np.uint8)
        mask[10:90, 30:66] = PERSON
        known = np.full(18, joints.PRESENT, np.int8)
        writer.add(picture, mask, STANDING + index, known, "film.mkv" if index % 2 else "stills", 96.0)
        writer.mark(str(index))
    return writer.close()


@pytest.fixture
def batches(tmp_path: Path) -> Batches:
    settings = settings_module.parse(TINY)
    scenes = np.random.default_rng(1).integers(0, 256, (3, 256, 256, 3), dtype=np.uint8)
    real, rendered = _store(tmp_path / "real", False), _store(tmp_path / "people", True)
    return Batches(real, rendered, scenes, settings.schedule, settings.seed)


def test_a_batch_depends_on_its_number_alone(batches: Batches) -> None:
    first, again = batches[1], batches[1]
    assert torch.equal(first[0], again[0]) and torch.equal(first[1], again[1])
    assert not torch.equal(first[0], batches[0][0])
    assert batches[3][0].shape == (4, 3, 96, 96) and batches[3][0].dtype == torch.uint8


def test_present_joints_lie_in_the_picture(batches: Batches) -> None:
    for step in range(4):
        rows = batches[step][1].numpy().reshape(-1, 3)
        size = TINY["schedule"][leg_of(step, batches.schedule)[0]]["size"]  # type: ignore[index]
        here = rows[rows[:, 2] == joints.PRESENT, :2]
        assert len(here) and (here >= 0).all() and (here <= size - 1).all()


def test_mirroring_keeps_the_sides_of_the_body() -> None:
    picture = np.full((96, 96, 3), 90, np.uint8)
    known = np.column_stack([STANDING, np.ones(18)]).astype(np.float32)
    sample = augment.Sample(picture, np.full((96, 96), PERSON, np.uint8), known, 200.0, True)
    seen_mirrored = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        seen_mirrored += augment.place(rng, sample, 96)[1]
        _, out = augment.augment(
            np.random.default_rng(seed), sample, 96, np.zeros((0, 256, 256, 3), np.uint8)
        )
        both = (out[[2, 5], 2] == joints.PRESENT).all()
        # the person faces us, mirrored or not: the right shoulder is on the left of the picture
        assert not both or out[2, 0] < out[5, 0]
    assert 0 < seen_mirrored < 20


def test_decoding_inverts_the_targets() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(12, 84, (3, 18, 2)).astype(np.float32)
    rows = torch.from_numpy(np.concatenate([places, np.ones((3, 18, 1), np.float32)], axis=2))
    maps = losses.target_maps(rows, 24, 24, 1.5).numpy()
    points, scores = decode.decode(maps, network.STRIDE)
    assert np.abs(points - places).max() < 0.35
    assert scores.min() > 0.85
    assert float(losses.offset_loss(torch.from_numpy(maps), rows)) < 0.12


def test_joints_that_are_not_known_do_not_count() -> None:
    heat = torch.rand(1, 18, 24, 24)
    rows = torch.tensor(np.column_stack([STANDING, np.full(18, joints.IGNORED)])[None], dtype=torch.float32)
    rows[0, 0, 2] = joints.ABSENT
    target = losses.target_maps(rows, 24, 24, 1.5)
    assert float(target.abs().max()) == 0
    changed = heat.clone()
    changed[0, 5] += 3
    assert torch.equal(losses.heat_loss(heat, target, rows), losses.heat_loss(changed, target, rows))


def test_an_interrupted_training_goes_on_and_the_export_is_the_same_network(
    batches: Batches, tmp_path: Path
) -> None:
    settings = settings_module.parse(TINY)
    whole, halves = tmp_path / "whole", tmp_path / "halves"
    whole.mkdir()
    halves.mkdir()
    straight = train(batches, settings, whole, progress=False)
    stopped = settings_module.parse({**TINY, "minutes": 1e-9})
    train(batches, stopped, halves, progress=False)
    assert torch.load(halves / "checkpoint.pt", weights_only=True)["step"] == 1
    resumed = train(batches, settings, halves, progress=False)
    for a, b in zip(straight.state_dict().values(), resumed.state_dict().values(), strict=True):
        assert torch.allclose(a.float(), b.float(), atol=2e-3)
    with (whole / "curve.csv").open(encoding="utf-8") as handle:
        assert [row["size"] for row in csv.DictReader(handle)] == ["64", "96"]
    path = tmp_path / "tiny.onnx"
    assert len(export.export(straight, path, 96)) == 64
    _both_runtimes_agree(path)


def test_a_network_that_grows_answers_as_before() -> None:
    torch.manual_seed(5)
    small = network.Compact((4, 4, 8, 8, 8), (1, 1, 2, 1), 2, 8)
    for module in small.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            assert module.running_var is not None and module.running_mean is not None
            for values in (module.weight, module.running_var):
                torch.nn.init.uniform_(values, 0.5, 2)
            torch.nn.init.normal_(module.bias)
            torch.nn.init.normal_(module.running_mean)
    large = network.Compact((4, 4, 8, 12, 16), (1, 1, 4, 2), 2, 8)
    grow(small, large)
    picture = torch.rand(2, 3, 64, 64) * 255
    with torch.no_grad():
        assert torch.allclose(small.eval()(picture), large.eval()(picture), atol=1e-6)
    with pytest.raises(ValueError, match="does not fit"):
        grow(large, network.Compact((4, 4, 8, 8, 16), (1, 1, 4, 2), 2, 8))


def test_a_training_grows_at_its_step(batches: Batches, tmp_path: Path) -> None:
    tiny = {"widths": [4, 4, 8, 8, 8], "depths": [1, 1, 1, 1], "expand": 2, "neck": 8}
    assert tiny == TINY["network"]
    wide = {**tiny, "widths": [4, 4, 8, 12, 8]}
    table = {**TINY, "first": tiny, "network": wide, "grow_at": 2, "mean_from": 3}
    settings = settings_module.parse(table)
    straight = train(batches, settings, tmp_path, progress=False)
    grown = dict(straight.named_modules())["stride16.0.body"]
    assert isinstance(grown, torch.nn.Sequential)
    assert isinstance(grown[-1], torch.nn.BatchNorm2d) and grown[-1].num_features == 12
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert state["step"] == 4
    early = torch.load(tmp_path / "anchor.pt", weights_only=True)["head.1.bias"]
    late = straight.state_dict()["head.1.bias"]
    assert torch.allclose(finished(tmp_path, settings).state_dict()["head.1.bias"], (early + late) / 2)
    assert torch.equal(finished(tmp_path, replace(settings, mean_from=0)).state_dict()["head.1.bias"], late)
    assert settings.network_at(1) == settings.first and settings.network_at(2) == settings.network


def _both_runtimes_agree(path: Path) -> None:
    import cv2
    import onnx
    import onnxruntime

    graph = onnx.load(str(path)).graph
    for node in graph.node:
        assert all(a.name != "auto_pad" or a.s == b"NOTSET" for a in node.attribute)
    net = cv2.dnn.readNetFromONNX(str(path))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    for count in (1, 3):
        feed = np.random.default_rng(count).uniform(0, 255, (count, 3, 96, 96)).astype(np.float32)
        expected = session.run(None, {"image": feed})[0]
        net.setInput(feed)
        assert expected.shape == (count, 19, 24, 24)
        assert np.abs(net.forward() - expected).max() < 1e-3


def test_a_network_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "LARGEST", 1000)
    with pytest.raises(ModelError, match="E_MODEL_SIZE"):
        export.export(network.Compact((4, 4, 8, 8, 8), (1, 1, 1, 1), 2, 8), tmp_path / "big.onnx", 64)


def test_the_shipped_configuration_is_read_and_wrong_keys_are_named() -> None:
    settings = settings_module.load()
    assert settings.schedule[-1].size == 192
    with pytest.raises(ConfigError, match="'colour'"):
        settings_module.parse({"data": {"colour": 1}})


def test_cut_out_holds_the_person_and_not_the_corners() -> None:
    picture = np.full((192, 192, 3), 200, np.uint8)
    for a, b in ((1, 8), (1, 11), (2, 4), (5, 7), (8, 10), (11, 13), (0, 1)):
        import cv2

        ends = [tuple(int(2 * v) for v in STANDING[j]) for j in (a, b)]
        cv2.line(picture, ends[0], ends[1], (20, 30, 60), 14)
    mask = cut_out(picture, STANDING * 2, np.ones(18, bool), np.ones((192, 192), bool))
    assert mask[int(STANDING[1, 1] * 2) + 20, 96] == PERSON
    assert (mask[:10, :10] != PERSON).all()


def test_evaluation_tells_swapped_sides_and_misses() -> None:
    truth = np.repeat(STANDING[None], 4, axis=0)
    got, scores = truth.copy(), np.ones((4, 18))
    got[1] = truth[1][joints.MIRROR]
    got[2] += 3.0
    scores[3, 4] = 0
    result = evaluate.compare(got, scores, truth, np.ones((4, 18), bool))
    assert result.swapped.tolist() == [False, True, False, False]
    assert np.nanmax(result.aligned[2]) < 1e-6 < np.nanmin(result.errors[2])
    assert np.isnan(result.errors[3, 4]) and not result.found[3, 4]


def test_a_swung_arm_keeps_its_pixels_and_its_joints() -> None:
    import cv2

    big = STANDING * 3
    picture = np.full((288, 288, 3), 200, np.uint8)
    mask = np.full((288, 288), 128, np.uint8)
    cv2.rectangle(mask, (100, 30), (190, 280), PERSON, -1)
    for chain in ((2, 3, 4), (5, 6, 7)):
        ends = [tuple(int(v) for v in big[j]) for j in chain]
        for a, b in pairwise(ends):
            cv2.line(picture, a, b, (20, 30, 160), 12)
            cv2.line(mask, a, b, PERSON, 12)
    rows = np.column_stack([big, np.full(18, joints.PRESENT)]).astype(np.float32)
    moved = [swing.swing(np.random.default_rng(seed), picture, mask, rows, 0) for seed in range(12)]
    for out, cover, new in filter(None, moved):
        apart = np.abs(new - rows)
        assert (np.delete(apart, (3, 4), axis=0) == 0).all()
        x, y = new[4, :2].round().astype(int)
        if 0 <= x < 288 and 0 <= y < 288:
            assert cover[y, x] == PERSON
            assert np.abs(out[y, x].astype(int) - (20, 30, 160)).max() < 60
    assert all(moved) and len({result[2][4].tobytes() for result in moved if result}) == 12
    rows[4, 2] = joints.IGNORED
    assert swing.swing(np.random.default_rng(0), picture, mask, rows, 0) is None


def test_a_skirt_goes_around_the_body_and_never_narrows() -> None:
    rng = np.random.default_rng(0)
    height = rng.uniform(-0.9, 0.2, 4000)
    around = rng.uniform(0, 2 * np.pi, 4000)
    radius = np.where(height > -0.1, 0.16, 0.09)
    body = np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
    cloth, faces = skirts.skirt(rng, body, np.ones(4000, bool), 0.05, -0.5)
    assert faces.max() < len(cloth) and np.isfinite(cloth).all()
    rings = np.linalg.norm(cloth[:, :2].reshape(skirts.RINGS, -1, 2), axis=2).mean(axis=1)
    assert rings[0] > 0.15 and (np.diff(rings) > -0.01).all()
    assert np.isclose(cloth[:, 2].max(), 0.05) and np.isclose(cloth[:, 2].min(), -0.5)


class _Voters:
    """Teachers that say what they are told, with one large look and one small look astray."""

    def __init__(self, lost: tuple[int, ...] = ()) -> None:
        self.lost, self.calls = lost, 0

    def _say(self, crop: np.ndarray, scale: float) -> list[tuple[np.ndarray, np.ndarray]]:
        self.calls += 1
        points = (STANDING - 48 + 0.5) * scale + crop.shape[0] / 2 - 0.5
        scores = np.full(18, 0.8)
        scores[list(self.lost)] = 0.01
        astray = points.copy()
        if self.calls == 1:
            astray[4] += 40 * scale
        return [(points, scores), (astray, scores)]

    def both_ways(self, crop: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        factor = next(f for f, size in label.WINDOWS if size == crop.shape[0])
        return self._say(crop, crop.shape[0] / (96 * factor))

    def movenet_both_ways(self, crop: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        factor = label.QUICK[(self.calls - len(label.WINDOWS)) % len(label.QUICK)]
        return self._say(crop, crop.shape[0] / (96 * factor))


def test_teachers_vote_and_a_hand_that_nobody_sees_is_not_called_absent() -> None:
    picture = np.zeros((96, 96, 3), np.uint8)
    box = (np.array([48.0, 48.0]), 96.0)
    result = label.agree(_Voters(), picture, *box, 0.15)  # type: ignore[arg-type]
    assert result is not None and (result[1] == joints.PRESENT).all()
    assert np.abs(result[0] - STANDING).max() < 1.0
    lost = (4, 13, 16)
    result = label.agree(_Voters(lost), picture, *box, 0.15)  # type: ignore[arg-type]
    assert result is not None
    assert result[1][list(lost)].tolist() == [joints.IGNORED, joints.ABSENT, joints.ABSENT]


def test_a_real_person_stands_on_rendered_legs() -> None:
    rows = np.column_stack([STANDING * 3, np.full(18, joints.PRESENT)]).astype(np.float32)
    real = rows.copy()
    real[[9, 10, 12, 13], 2] = joints.ABSENT
    lender = rows.copy()
    lender[[4, 7], 1] = 90  # hands up
    picture, mask = np.full((288, 288, 3), 10, np.uint8), np.zeros((288, 288), np.uint8)
    mask[30:170, 90:200] = PERSON
    body, opacity = np.full((288, 288, 3), 200, np.uint8), np.full((288, 288), 255, np.uint8)
    rng = np.random.default_rng(0)
    result = legs.stand(rng, picture, mask, real, (body, opacity, lender))
    assert result is not None
    out, cover, new = result
    assert (new[:, 2] == joints.PRESENT).all()
    feet, neck = new[[10, 13], :2].round().astype(int), new[joints.NECK, :2].round().astype(int)
    assert (out[feet[:, 1], feet[:, 0]] == 200).all() and (out[neck[1], neck[0]] == 10).all()
    assert (cover[feet[:, 1], feet[:, 0]] == PERSON).all()
    # the proportions stay those of the two: hips are shared, so the legs begin where the trunk ends
    assert np.abs(new[[8, 11], :2].mean(axis=0) - [144, 135]).max() < 1
    lender[4, 1] = 200  # a hand beside the legs would be a third one
    assert legs.stand(rng, picture, mask, real, (body, opacity, lender)) is None


def test_bars_cut_a_body_at_their_edge() -> None:
    picture = np.full((96, 96, 3), 90, np.uint8)
    rows = np.column_stack([STANDING, np.ones(18)]).astype(np.float32)
    sample = augment.Sample(picture, np.full((96, 96), PERSON, np.uint8), rows, 60.0, False)
    seen = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        matrix, _ = augment.place(rng, sample, 96, (0, 12))
        middle = STANDING.mean(axis=0)
        assert (matrix @ [middle[0], 60.0, 1])[1] > 96 - 12 - 8  # a little slack: bodies are turned
        seen.add(augment.bars(np.random.default_rng(seed), 192))
    assert (0, 0) in seen and (0, 24) in seen


def test_the_pictures_of_the_card_are_drawn(tmp_path: Path) -> None:
    import cv2

    log = tmp_path / "curve.csv"
    log.write_text(
        "step,images,minutes,size,rate,heat,offset_cells\n1,32,0.1,96,1e-3,2.0,1.5\n2,64,0.2,96,1e-3,1.0,1.2\n"
        "3,96,0.3,192,1e-3,0.5,1.0\n",
        encoding="utf-8",
    )
    show.curve(log, tmp_path / "curve.png")
    picture = cv2.imread(str(tmp_path / "curve.png"))
    assert picture is not None and picture.shape[1] > 300
    drawn = show.skeleton(np.full((96, 96, 3), 90, np.uint8), STANDING, np.ones(18))
    assert drawn.shape == (96, 96, 3) and (drawn != 90).any()
    hidden = show.skeleton(np.full((96, 96, 3), 90, np.uint8), STANDING, np.zeros(18))
    assert (hidden == 90).all()
