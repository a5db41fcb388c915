"""Pictures: a room written for pbrt is the room written for us."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rptcam_cl
from tests.rendering.pictures import batches, pixels
from tests.support.statistics import ALPHA, sidak, tiles, welch

Convert = Callable[..., Any]
ROOM = Path(__file__).parents[2] / "data" / "reference" / "B.yaml"
SIZE = 48
BATCHES, SPP = 4, 16


def box_sides(item: dict[str, Any]) -> list[dict[str, Any]]:
    """The five sides of a box that stands on the floor, as rectangles with the box's transform."""
    (x0, y0, z0), (x1, y1, z1) = item["min"], item["max"]
    dx, dy, dz = [x1 - x0, 0, 0], [0, y1 - y0, 0], [0, 0, z1 - z0]
    sides = [((x0, y0, z1), dx, dy), ((x0, y0, z0), dx, dz), ((x1, y1, z0), [-dx[0], 0, 0], dz),
             ((x0, y1, z0), [0, -dy[1], 0], dz), ((x1, y0, z0), dy, dz)]  # fmt: skip
    return [
        {"shape": "rectangle", "corner": list(corner), "edge_u": u, "edge_v": v, "material": item["material"],
         "transform": item["transform"]}
        for corner, u, v in sides
    ]  # fmt: skip


def room() -> dict[str, Any]:
    """The reference scene B with its boxes as rectangles."""
    scene: dict[str, Any] = yaml.safe_load(ROOM.read_text("utf-8"))
    objects = []
    for item in scene["objects"]:
        objects += box_sides(item) if item["shape"] == "box" else [item]
    return {**scene, "objects": objects, "film": {"resolution": [SIZE, SIZE]}}


def room_of_pbrt(version: int, *, left_handed: bool = False) -> str:
    """The same room as a text for pbrt, whose world is left-handed if wanted."""
    sign = -1 if left_handed else 1
    lines = ["LookAt 0 -3.9 0  0 0 0  0 0 1" if left_handed else "Scale -1 1 1 LookAt 0 -3.9 0  0 0 0  0 0 1"]
    film = "image" if version == 3 else "rgb"
    lines += [
        'Camera "perspective" "float fov" 39.3',
        f'Film "{film}" "integer xresolution" {SIZE} "integer yresolution" {SIZE} "string filename" "b.exr"',
        'PixelFilter "box"',
        'Integrator "path" "integer maxdepth" 7 Sampler "halton" "integer pixelsamples" 64 WorldBegin',
    ]
    scene = room()
    for name, material in scene["materials"].items():
        if material["kind"] == "matte":
            kind, key = ("matte", "Kd") if version == 3 else ("diffuse", "reflectance")
            rgb = " ".join(map(str, material["reflectance"]))
            lines.append(f'MakeNamedMaterial "{name}" "string type" "{kind}" "rgb {key}" [{rgb}]')
    for item in scene["objects"]:
        corner, u, v = (np.array(item[key], float) for key in ("corner", "edge_u", "edge_v"))
        points = np.array([corner, corner + u, corner + u + v, corner + v]) * [sign, 1, 1]
        order = "0 2 1 0 3 2" if left_handed else "0 1 2 0 2 3"  # the same front
        lines.append("AttributeBegin")
        for step in reversed(item.get("transform", [])):
            if "rotate" in step:
                lines.append(f"Rotate {sign * step['rotate']['degrees']} 0 0 1")
            else:
                x, y, z = step["translate"]
                lines.append(f"Translate {sign * x} {y} {z}")
        if item["material"] == "lamp":
            kind, key = ("matte", "Kd") if version == 3 else ("diffuse", "reflectance")
            lines.append(f'AreaLightSource "diffuse" "rgb L" [17 12 4] Material "{kind}" "rgb {key}" [0 0 0]')
        else:
            lines.append(f'NamedMaterial "{item["material"]}"')
        flat = " ".join(repr(float(number)) for number in points.reshape(-1))
        lines.append(f'Shape "trianglemesh" "point3 P" [{flat}] "integer indices" [{order}]\nAttributeEnd')
    return "\n".join([*lines, "WorldEnd"] if version == 3 else lines)


@pytest.fixture(scope="module")
def ours() -> Any:
    return batches(room(), "pbrt room", BATCHES, spp=SPP)


def test_upright_walls_are_the_same_rectangles(convert: Convert) -> None:
    done = convert("", room_of_pbrt(4))
    for got, wanted in zip(done.objects, room()["objects"], strict=True):
        assert got["shape"] == "rectangle"
        if "transform" not in wanted:
            for key in ("corner", "edge_u", "edge_v"):
                np.testing.assert_allclose(got[key], wanted[key], atol=1e-12)


@pytest.mark.parametrize("version", [3, 4])
def test_picture_is_the_same_bit_by_bit(convert: Convert, version: int) -> None:
    """Where the numbers are the same the picture is; the boxes, whose turn is multiplied out, are left out here."""
    scene = room()
    scene["objects"] = [item for item in scene["objects"] if "transform" not in item]
    text = room_of_pbrt(version)
    kept = "AttributeBegin".join(part for part in text.split("AttributeBegin") if "Rotate" not in part)
    done = convert("", kept + ("\nWorldEnd" if version == 3 and "WorldEnd" not in kept else ""))
    assert done.report == []
    options = {"spp": 2, "seed": 5, "size": (SIZE, SIZE)}
    expected = pixels({**scene, "render": {**scene["render"], "roulette_depth": 4}}, **options)
    np.testing.assert_array_equal(np.asarray(rptcam_cl.render(done.scene, **options)), expected.astype(np.float32))


@pytest.mark.parametrize("left_handed", [False, True])
def test_picture_agrees_with_ours(convert: Convert, ours: Any, left_handed: bool) -> None:
    done = convert("", room_of_pbrt(4, left_handed=left_handed))
    theirs = batches(done.scene, f"pbrt room {left_handed}", BATCHES, spp=SPP)
    p = welch(tiles(theirs), tiles(ours))
    assert p.min() > sidak(ALPHA, p.size)


def test_a_mirrored_picture_would_be_seen(convert: Convert, ours: Any) -> None:
    text = room_of_pbrt(4).replace("Scale -1 1 1 LookAt", "LookAt")
    theirs = batches(convert("", text).scene, "pbrt room mirrored", BATCHES, spp=SPP)
    p = welch(tiles(theirs), tiles(ours))
    assert p.min() < sidak(ALPHA, p.size)
