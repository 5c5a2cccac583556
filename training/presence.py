"""Whether somebody is in the picture: a small head on the trained network, which stays as it is.

What the head sees: the mean and the maximum of each feature of the coarsest stage, and of each heat map. The
backbone and the heat maps keep their bytes; the file gets a second output, ``presence``.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.pose.models import find_model
from gesture_core.pose.network import Letterbox, NetworkBackend, to_batch

from .windows import Example, Track, drawn, photographed

if TYPE_CHECKING:
    import onnx

OUTPUT, OWN = "presence", "presence."
"""Name of the output, and what the names of the head's nodes and weights begin with."""
HIDDEN, STEPS, RATE, DECAY = 24, 1500, 3e-3, 2e-3
FOLDS = 5
NOBODY = 0.9
"""Share of windows without a person that 0.5 is meant for: a search looks at many for one that has one."""
SOURCES = ("people_permissive", "people_more", "drawn")
_BATCH = 64


@dataclass(frozen=True)
class Table:
    """Features (N, D) of N windows, whether somebody is there, what is held out together, and the kind."""

    features: np.ndarray
    person: np.ndarray
    groups: np.ndarray
    kinds: np.ndarray


@dataclass(frozen=True)
class Head:
    """Two layers: ``second @ relu(first @ features + bias) + offset`` is the logit."""

    first: np.ndarray
    bias: np.ndarray
    second: np.ndarray
    offset: float

    def logits(self, features: np.ndarray) -> np.ndarray:
        """(N,) of (N, D) features."""
        found: np.ndarray = np.maximum(features @ self.first.T + self.bias, 0) @ self.second + self.offset
        return found


def without_head(model: onnx.ModelProto) -> onnx.ModelProto:
    """The network alone, as it was before it had a head."""
    import onnx

    plain = onnx.ModelProto()
    plain.CopyFrom(model)
    graph = plain.graph
    for part in (graph.node, graph.initializer):
        for thing in [thing for thing in part if thing.name.startswith(OWN)]:
            part.remove(thing)
    for output in [output for output in graph.output if output.name == OUTPUT]:
        graph.output.remove(output)
    return plain


def _taps(graph: onnx.GraphProto) -> tuple[str, str]:
    """Names of the coarsest features, which the top-down path begins with, and of the heat maps."""
    maker = {name: node for node in graph.node for name in node.output}
    first = next(node for node in graph.node if node.op_type == "Resize")
    maps = maker[graph.output[0].name]
    return maker[first.input[0]].input[0], maps.input[0]


def _pools(graph: onnx.GraphProto) -> tuple[list[onnx.NodeProto], str]:
    """Nodes that make the features of the head, and the name of the result (N, D, 1, 1)."""
    from onnx import helper

    nodes, names = [], []
    for where, tap in zip(("coarse", "heat"), _taps(graph), strict=True):
        for kind in ("Average", "Max"):
            name = f"{OWN}{where}.{kind.lower()}"
            nodes.append(helper.make_node(f"Global{kind}Pool", [tap], [name], name))
            names.append(name)
    nodes.append(helper.make_node("Concat", names, [f"{OWN}features"], f"{OWN}features", axis=1))
    return nodes, f"{OWN}features"


def attach(model: onnx.ModelProto, head: Head) -> onnx.ModelProto:
    """The network with the output ``presence``, (N, 1) in 0..1."""
    from onnx import TensorProto, helper, numpy_helper

    whole = without_head(model)
    graph = whole.graph
    nodes, features = _pools(graph)
    weights = {
        "first": head.first[..., None, None],
        "bias": head.bias,
        "second": head.second[None, :, None, None],
        "offset": np.array([head.offset]),
    }
    for name, values in weights.items():
        graph.initializer.append(numpy_helper.from_array(values.astype(np.float32), f"{OWN}{name}"))
    steps = [("Conv", "first", "bias"), ("Relu",), ("Conv", "second", "offset"), ("Sigmoid",), ("Flatten",)]
    for number, (kind, *given) in enumerate(steps):
        result = OUTPUT if kind == "Flatten" else f"{OWN}{number}"
        inputs = [features, *(f"{OWN}{name}" for name in given)]
        nodes.append(helper.make_node(kind, inputs, [result], f"{OWN}{number}"))
        features = result
    graph.node.extend(nodes)
    graph.output.append(helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["batch", 1]))
    return whole


def features_of(model: onnx.ModelProto, windows: Iterable[Example], backend: NetworkBackend) -> Table:
    """What the head sees of each window."""
    import onnxruntime
    from onnx import TensorProto, helper

    probe = without_head(model)
    nodes, name = _pools(probe.graph)
    probe.graph.node.extend(nodes)
    probe.graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, None))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        probe.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    found: list[np.ndarray] = []
    batch: list[np.ndarray] = []
    facts: list[tuple[bool, str, str]] = []

    def run() -> None:
        if batch:
            (features,) = session.run([name], {"image": np.concatenate(batch)})
            found.append(features[:, :, 0, 0])
            batch.clear()

    for window in windows:
        size = backend.contract.input_size or (192, 192)
        box = Letterbox.fit((window.picture.shape[1], window.picture.shape[0]), size)
        batch.append(to_batch([window.picture], box, backend.contract))
        facts.append((window.person, window.group, window.kind))
        if len(batch) == _BATCH:
            run()
    run()
    person, groups, kinds = zip(*facts, strict=True)
    return Table(np.concatenate(found), np.array(person), np.array(groups), np.array(kinds))


def fit(table: Table, seed: int) -> Head:
    """Train a head; every group weighs as the root of its size, both answers weigh the same."""
    import torch

    torch.manual_seed(seed)
    weights = _weights(table)
    mean = np.average(table.features, axis=0, weights=weights)
    spread = np.sqrt(np.average((table.features - mean) ** 2, axis=0, weights=weights)) + 1e-3
    inputs = torch.tensor((table.features - mean) / spread, dtype=torch.float32)
    wanted = torch.tensor(table.person, dtype=torch.float32)
    network = torch.nn.Sequential(
        torch.nn.Linear(inputs.shape[1], HIDDEN), torch.nn.ReLU(), torch.nn.Linear(HIDDEN, 1)
    )
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    slower = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=STEPS)
    draws = torch.Generator().manual_seed(seed)
    chances = torch.tensor(weights, dtype=torch.float64)
    for _ in range(STEPS):
        chosen = torch.multinomial(chances, 512, replacement=True, generator=draws)
        noisy = inputs[chosen] * (1 + 0.1 * torch.randn(512, inputs.shape[1], generator=draws))
        loss = torch.nn.functional.binary_cross_entropy_with_logits(network(noisy)[:, 0], wanted[chosen])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        slower.step()
    first, last = (network[i] for i in (0, 2))
    scaled = first.weight.detach().numpy() / spread
    return Head(
        scaled,
        first.bias.detach().numpy() - scaled @ mean,
        last.weight.detach().numpy()[0],
        float(last.bias.detach()),
    )


def _weights(table: Table) -> np.ndarray:
    """(N,) of the windows: each kind as the root of its size, with and without a person half of all."""
    weights = np.zeros(len(table.person))
    for kind in np.unique(table.kinds):
        here = table.kinds == kind
        weights[here] = here.sum() ** -0.5
    for person in (False, True):
        here = table.person == person
        weights[here] *= 0.5 / weights[here].sum()
    return weights


def held_out(table: Table, seed: int) -> np.ndarray:
    """(N,) logits of heads that saw nothing of a window's group."""
    names = np.unique(table.groups)
    fold_of = dict(
        zip(np.random.default_rng(seed).permutation(names), np.arange(len(names)) % FOLDS, strict=True)
    )
    folds = np.array([fold_of[group] for group in table.groups])
    logits = np.zeros(len(folds))
    for fold in range(FOLDS):
        out = folds == fold
        seen = Table(*(part[~out] for part in vars(table).values()))
        logits[out] = fit(seen, seed).logits(table.features[out])
    return logits


def calibrate(head: Head, logits: np.ndarray, table: Table) -> tuple[Head, tuple[float, float]]:
    """The head with its logits scaled and moved to be log odds on held-out windows (Platt 1999).

    `NOBODY` of the windows are taken to have nobody.
    """
    from scipy.optimize import minimize

    weights = _weights(table) * np.where(table.person, 1 - NOBODY, NOBODY)
    sign = np.where(table.person, 1.0, -1.0)

    def loss(line: np.ndarray) -> float:
        return float(np.sum(weights * np.logaddexp(0, -sign * (line[0] * logits + line[1]))))

    slope, shift = minimize(loss, np.array([1.0, 0.0]), method="Nelder-Mead").x
    scaled = Head(head.first, head.bias, head.second * slope, float(head.offset * slope + shift))
    return scaled, (float(slope), float(shift))


def report(table: Table, logits: np.ndarray) -> str:
    """Of each kind of held-out window, how many are taken for the other answer at 0.5."""
    lines = ["| windows | of | number | called a person at 0.5 |", "|---|---|---|---|"]
    totals: dict[str, list[np.ndarray]] = defaultdict(list)
    for kind in np.unique(table.kinds):
        what, _, name = str(kind).partition(": ")
        called = logits[table.kinds == kind] > 0
        totals[what].append(called)
        lines.append(f"| {what} | {name} | {len(called)} | {called.mean():.1%} |")
    for what, parts in totals.items():
        every = np.concatenate(parts)
        lines.append(f"| {what} | all | {len(every)} | {every.mean():.2%} |")
    return "\n".join(lines)


def presence(path: Path, shared: Path, work: Path, seed: int, track: Track) -> str:
    """Give the network in ``path`` a head; returns the table of held-out windows and the file's SHA-256."""
    import onnx

    model = without_head(onnx.load(str(path)))
    tables = [table_of(name, model, shared, work, seed, track) for name in SOURCES]
    table = Table(*(np.concatenate(parts) for parts in zip(*(vars(t).values() for t in tables), strict=True)))
    logits = held_out(table, seed)
    head, (slope, shift) = calibrate(fit(table, seed), logits, table)
    data = attach(model, head).SerializeToString()
    path.write_bytes(data)
    return f"{report(table, slope * logits + shift)}\n{path}: SHA-256 {hashlib.sha256(data).hexdigest()}"


def table_of(name: str, model: onnx.ModelProto, shared: Path, work: Path, seed: int, track: Track) -> Table:
    """What the head sees of all windows of one of `SOURCES`, kept in the work folder."""
    from gesture_core.plugin import registry

    kept = work / f"presence-{name}.npz"
    if not kept.exists():
        options = {"threads": 1, "presence": 0.0}
        backend: NetworkBackend = registry().make("pose", "onnx", options, model=find_model("compact"))
        windows = (
            drawn(seed, track)
            if name == "drawn"
            else photographed(shared / "data" / name, backend, seed, track)
        )
        table = features_of(model, windows, backend)
        work.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(kept, **vars(table))
    with np.load(kept, allow_pickle=False) as stored:
        return Table(**stored)
