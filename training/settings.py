"""The one configuration of a training: a frozen tree, read from TOML."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path

from gesture_core.errors import ConfigError

DEFAULT = Path(__file__).with_name("config.toml")


@dataclass(frozen=True)
class Data:
    """Sizes of the two caches of training pictures."""

    frame_step: int = 2  # every n-th frame of a video
    sparse_step: int = 6  # the same for the collections in `sparse`
    sparse: tuple[str, ...] = ("pose2sim", "moviepy")  # films whose frames hardly differ
    stored: int = 288  # pixels of the square that a picture is stored in
    margin: float = 1.7  # side of a stored real crop over the longer side of the person's box
    agree: float = 0.15  # teachers may differ by so many shoulder widths
    synthetic: int = 8000  # rendered people


@dataclass(frozen=True)
class Network:
    """Arguments of `network.Compact`."""

    widths: tuple[int, ...] = (16, 24, 48, 96, 128)
    depths: tuple[int, ...] = (1, 2, 4, 3)
    expand: int = 4
    neck: int = 48
    fused: bool = True


@dataclass(frozen=True)
class Schedule:
    """One leg of the training; legs follow each other, each with its own picture size."""

    steps: int
    size: int = 192
    batch: int = 32
    real: float = 0.5  # share of real pictures in a batch
    rate: float = 2e-3  # peak learning rate of the leg
    offset: float = 0.0  # weight of the soft-argmax loss
    final: float = 0.0  # share of the rate left at the end of the leg; 0: what the next one begins with


@dataclass(frozen=True)
class Settings:
    """Everything that decides the weights, besides the pictures themselves."""

    seed: int = 1
    threads: int = 2
    sigma: float = 1.5  # cells
    weight_decay: float = 1e-2
    average: float = 0.998  # decay of the averaged weights
    mean_from: int = 0  # step whose averaged weights are averaged once more with the last ones, 0 for none
    checkpoint_steps: int = 100
    minutes: float = 0.0  # stop after so many minutes of training, 0 for no limit
    data: Data = field(default_factory=Data)
    network: Network = field(default_factory=Network)
    first: Network | None = None  # what the training begins with, where it grows on the way
    grow_at: int = 0  # step at which `first` becomes `network`
    schedule: tuple[Schedule, ...] = (Schedule(steps=1000),)

    def network_at(self, step: int) -> Network:
        """What is trained at ``step``."""
        return self.first if self.first is not None and step < self.grow_at else self.network


def _leaf(kind: type, table: dict[str, object], where: str) -> object:
    known = {f.name for f in fields(kind)}
    for key in table:
        if key not in known:
            raise ConfigError(f"unknown key {key!r} in {where}", remedy=f"one of {', '.join(sorted(known))}")
    return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in table.items()})


def load(path: Path = DEFAULT) -> Settings:
    """Read ``path``; a ConfigError names an unknown key."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return parse(table)


def parse(table: dict[str, object]) -> Settings:
    """Settings from the tables of a TOML file."""
    rest = dict(table)
    data = _leaf(Data, rest.pop("data", {}), "data")  # type: ignore[arg-type]
    network = _leaf(Network, rest.pop("network", {}), "network")  # type: ignore[arg-type]
    first = rest.pop("first", None)
    begins = None if first is None else _leaf(Network, first, "first")  # type: ignore[arg-type]
    legs = tuple(_leaf(Schedule, leg, "schedule") for leg in rest.pop("schedule", [{"steps": 1000}]))  # type: ignore[arg-type,attr-defined]
    whole = {**rest, "data": data, "network": network, "first": begins, "schedule": legs}
    return _leaf(Settings, whole, "the file")  # type: ignore[return-value]
