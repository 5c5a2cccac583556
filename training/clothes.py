"""What a rendered person wears: region by region, a colour or a pattern, from the body at rest."""

from __future__ import annotations

import numpy as np

SKIN, SHIRT, TROUSERS, SHOES, HAIR, EYE, LIPS, GLASSES, SKIRT, MASK = range(10)


def region_of_bone(bone: str) -> str:
    """Part of the body that a bone moves."""
    base = bone.split(".")[0]
    if base.startswith(("finger", "metacarpal", "wrist")):
        return "hand"
    for key, name in (
        ("lowerarm02", "forearm"), ("lowerarm01", "forearm"), ("upperarm", "upperarm"),
        ("upperleg", "thigh"), ("lowerleg", "shin"), ("foot", "foot"), ("toe", "foot"),
        ("head", "head"), ("eye", "eye"), ("neck", "neck"),
    ):  # fmt: skip
        if base.startswith(key):
            return name
    return "trunk"


def random_skin(rng: np.random.Generator) -> np.ndarray:
    """BGR skin colour, from very light to very dark."""
    light, dark = np.array([175.0, 195.0, 232.0]), np.array([38.0, 52.0, 82.0])
    tone = rng.beta(1.1, 1.6)
    return (light + (dark - light) * tone) * rng.uniform(0.92, 1.08, 3)


def random_cloth(rng: np.random.Generator) -> np.ndarray:
    """BGR colour of a garment: dark, light, grey or saturated."""
    kind = rng.random()
    if kind < 0.38:
        return rng.uniform(4, 60) + rng.normal(0, 6, 3)
    if kind < 0.5:
        return rng.uniform(170, 245) + rng.normal(0, 10, 3)
    if kind < 0.65:
        return rng.uniform(70, 170) + rng.normal(0, 12, 3)
    return rng.uniform(0, 255, 3)


def dress(
    rng: np.random.Generator, rest: np.ndarray, owner: np.ndarray, bones: list[str], skirt: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Material of each vertex, and how far cloth or hair stands off the skin.

    Parameters
    ----------
    rest : (V, 3) body at rest, metres
    owner : (V,) bone that moves each vertex most
    skirt : bool
        Whether a skirt will be worn: bare legs, and more often bare shoulders.

    Returns
    -------
    material : (V,) int
    offset : (V,) metres along the normal
    """
    parts = np.array([region_of_bone(b) for b in bones])[owner]
    material = np.full(len(rest), SKIN)
    offset = np.zeros(len(rest))
    x, y, z = rest.T
    trunk = parts == "trunk"
    top, low = z[trunk].max(), z[trunk].min()
    belt = low + (top - low) * rng.uniform(0.12, 0.35)
    neckline = top - (top - low) * rng.uniform(0.0, 0.12)
    scoop = (y < 0) & (np.abs(x) < rng.uniform(0.04, 0.09))
    shirt = trunk & (z > belt) & ~(scoop & (z > neckline))
    sleeves = [0.45, 0.3, 0.05, 0.2] if skirt else [0.14, 0.42, 0.1, 0.34]
    sleeve = rng.choice(["none", "short", "three", "long"], p=sleeves)
    if sleeve == "none":  # straps: the shoulders are bare
        shirt &= ~((z > neckline - 0.06) & (np.abs(x) > rng.uniform(0.1, 0.16)))
        if rng.random() < 0.5:
            deep = top - (top - low) * rng.uniform(0.08, 0.22)
            shirt &= ~((z > deep) & (np.abs(x) < rng.uniform(0.05, 0.1)))
    arm = parts == "upperarm"
    reach = np.abs(x)
    if sleeve == "short":
        edge = np.quantile(reach[arm], rng.uniform(0.35, 0.9))
        shirt |= arm & (reach < edge)
    elif sleeve != "none":
        fore = parts == "forearm"
        edge = np.quantile(reach[fore], 1.0 if sleeve == "long" else rng.uniform(0.2, 0.8))
        shirt |= arm | (fore & (reach <= edge))
    if rng.random() < 0.15:
        shirt |= (parts == "neck") & (z < np.quantile(z[parts == "neck"], rng.uniform(0.3, 1)))
    thigh, shin = parts == "thigh", parts == "shin"
    trousers = (trunk & ~shirt & (z <= belt)) | thigh
    if skirt and rng.random() < 0.8:
        trousers &= ~thigh
    elif rng.random() < 0.6:
        trousers |= shin
    elif rng.random() < 0.85:  # shorts, down to the knee or less
        trousers &= ~thigh | (z > np.quantile(z[thigh], rng.uniform(0.0, 0.6)))
        if rng.random() < 0.3:
            trousers |= shin & (z > np.quantile(z[shin], rng.uniform(0.5, 0.95)))
    material[trousers], material[shirt] = TROUSERS, SHIRT
    if rng.random() < (0.6 if skirt else 0.9):
        material[parts == "foot"] = SHOES
    loose = abs(rng.normal(0.01, 0.014))
    waves = 0.006 * np.sin(rng.uniform(10, 60) * z + rng.uniform(10, 40) * x + rng.uniform(0, 6))
    offset[shirt] = loose + waves[shirt] * min(1.0, loose * 80)
    offset[trousers] = abs(rng.normal(0.006, 0.01))
    _head(rng, rest, parts, material, offset)
    return material, offset


def _head(
    rng: np.random.Generator, rest: np.ndarray, parts: np.ndarray, material: np.ndarray, offset: np.ndarray
) -> None:
    """Hair, beard, eyes, brows, lips and glasses, by place in the head's box."""
    head = (parts == "head") | (parts == "eye")
    low, high = rest[head].min(axis=0), rest[head].max(axis=0)
    x, y, z = ((rest - low) / (high - low)).T  # y 0 in front, z 1 on top
    line = rng.uniform(0.72, 0.9)
    hair = head & ((z > line) | ((y > rng.uniform(0.42, 0.6)) & (z > rng.uniform(0.15, 0.5))))
    if rng.random() < 0.88:
        material[hair] = HAIR
        offset[hair] = rng.uniform(0.003, 0.03)
    front = head & (y < 0.4)
    if rng.random() < 0.25:  # a beard
        material[front & (z < 0.33)] = HAIR
    brows = front & (np.abs(z - 0.64) < 0.02) & (np.abs(np.abs(x - 0.5) - 0.17) < 0.12)
    material[brows] = HAIR
    material[front & (np.abs(z - 0.27) < 0.025) & (np.abs(x - 0.5) < 0.14)] = LIPS
    material[parts == "eye"] = EYE
    if rng.random() < 0.2:  # a mask over mouth and nose
        cover = (
            head & (y < rng.uniform(0.5, 0.7)) & (z < rng.uniform(0.4, 0.5)) & (z > rng.uniform(0.0, 0.15))
        )
        material[cover] = MASK
        offset[cover] = rng.uniform(0.002, 0.012)
    if rng.random() < 0.25:
        ring = np.hypot((np.abs(x - 0.5) - 0.2) / 0.15, (z - 0.555) / 0.08)
        material[front & (np.abs(ring - 1) < 0.3)] = GLASSES


def paint(
    rng: np.random.Generator, material: np.ndarray, place: np.ndarray, patches: list[np.ndarray]
) -> np.ndarray:
    """Colour of surface points; a skirt is half of the time of the same cloth as the shirt: a dress.

    Parameters
    ----------
    material : (P,) int
    place : (P, 3) where the point is on the body at rest, metres
    patches : list of (h, w, 3) uint8
        Pictures that may become the pattern of a cloth.

    Returns
    -------
    (P, 3) float BGR, 0..255
    """
    if rng.random() < 0.5:
        material = np.where(material == SKIRT, SHIRT, material)
    if rng.random() < 0.12:  # all of one cloth
        material = np.where(material == TROUSERS, SHIRT, material)
    colours = np.zeros((10, 3))
    skin = random_skin(rng)
    colours[SKIN], colours[LIPS] = skin, skin * np.array([0.75, 0.65, 0.95])
    for garment in (SHIRT, TROUSERS, SHOES, SKIRT):
        colours[garment] = random_cloth(rng)
    colours[MASK] = [(225, 225, 225), (215, 190, 130), (35, 35, 35), rng.uniform(20, 230, 3)][rng.integers(4)]
    hair = np.array([25, 30, 40]) if rng.random() < 0.5 else rng.uniform(20, 200) * np.array([0.5, 0.75, 1.0])
    colours[HAIR], colours[EYE], colours[GLASSES] = hair, [60, 60, 60], [30, 30, 30]
    out = colours[material]
    for cloth, chance in ((SHIRT, 0.5), (TROUSERS, 0.2), (SKIRT, 0.4)):
        on = material == cloth
        if on.any() and rng.random() < chance:
            out[on] = _pattern(rng, place[on], colours[cloth], patches)
    return out


def _pattern(
    rng: np.random.Generator, place: np.ndarray, base: np.ndarray, patches: list[np.ndarray]
) -> np.ndarray:
    """Stripes, checks, a print on the chest, or a piece of a picture."""
    other = random_cloth(rng)
    kind = rng.choice(["stripes", "checks", "print", "patch"], p=[0.25, 0.15, 0.2, 0.4])
    if kind == "patch" and patches:
        patch = patches[rng.integers(len(patches))]
        height, width = patch.shape[:2]
        scale = rng.uniform(150, 900)
        u = (np.abs(place[:, 0] + 0.3 * place[:, 1]) * scale).astype(int) % width
        v = (np.abs(place[:, 2]) * scale).astype(int) % height
        return patch[v, u].astype(float) * rng.uniform(0.5, 1.1) + rng.uniform(-20, 20, 3)
    frequency = rng.uniform(30, 250)
    rows = np.sin(place[:, 2] * frequency) > rng.uniform(-0.5, 0.5)
    columns = np.sin(place[:, 0] * frequency) > rng.uniform(-0.5, 0.5)
    if kind == "stripes":
        on = rows if rng.random() < 0.7 else columns
    elif kind == "checks":
        on = rows ^ columns
    else:
        center = np.array([rng.normal(0, 0.03), rng.uniform(0.25, 0.45)])
        far = np.abs(place[:, [0, 2]] - center)
        on = (far < rng.uniform(0.03, 0.12, 2)).all(axis=1) & (place[:, 1] < 0)
    return np.where(on[:, None], other, base)
