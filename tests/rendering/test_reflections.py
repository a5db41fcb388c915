"""Reflections in round and rough mirrors against closed forms and integrals, and what pictures show."""

from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering import highlights as of_highlights
from rptcam_cl.rendering.highlights import (
    Front,
    MirrorFaces,
    MirrorSights,
    Reflections,
    highlights,
    lamps_among,
    may_reflect,
    polished_faces,
    reflections,
)
from rptcam_cl.rendering.lamps import occluded, points_of
from rptcam_cl.rendering.plan.materials import lobes_of
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.scene import Scene
from tests.device.probes import open_session

CENTRE, RADIUS = np.array([0.3, -0.2, -1.0]), 0.03
MIRROR = {"kind": "mirror"}


def plan_of(*objects: dict[str, Any], lights: tuple[dict[str, Any], ...] = ()) -> Any:
    camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 60}
    return make_plan(Scene.model_validate({"camera": camera, "objects": list(objects), "lights": list(lights)}))


def ball(material: dict[str, Any] = MIRROR) -> dict[str, Any]:
    return {"shape": "sphere", "center": CENTRE.tolist(), "radius": RADIUS, "material": material}


def seen(faces: MirrorFaces, eye: np.ndarray, lamp: np.ndarray) -> Reflections:
    count = len(faces)
    sights = MirrorSights(faces, np.tile(eye, (count, 1)), np.tile(lamp, (count, 1)), np.zeros((count, 2)))
    may = may_reflect(sights, np.zeros(count))
    assert may.sum() < count / 4
    return reflections(sights[may], 1e9)


def curvatures(found: Reflections, which: int) -> np.ndarray:
    """Return the two curvatures of the wave: the third, along the light, is their mean."""
    return np.sort(np.linalg.eigvalsh(found.bend[which]))[[0, 2]]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("far", [True, False])
def test_a_ball_shows_a_lamp_as_its_closed_form_says(seed: int, far: bool) -> None:
    rng = np.random.default_rng(seed)
    eye, towards = 0.02 * rng.normal(size=3), rng.normal(size=3)
    lamp = np.append(towards / np.linalg.norm(towards), 0.0) if far else np.append(CENTRE + towards, 1.0)
    found = seen(next(polished_faces(plan_of(ball()))), eye, lamp)
    front = np.flatnonzero(~found.behind)
    assert len(front) == 1
    k = int(front[0])
    away = np.linalg.norm(found.points[k] - eye)
    lit = 0.0 if far else 1.0 / np.linalg.norm(lamp[:3] - found.points[k])
    bends = lit + 2.0 / (RADIUS * found.cosine[k]), lit + 2.0 * found.cosine[k] / RADIUS  # across and in its plane
    assert np.linalg.norm(found.points[k] - CENTRE) == pytest.approx(RADIUS, rel=1e-5)  # records are of float32
    assert curvatures(found, k) == pytest.approx(sorted(b / (1.0 + b * away) for b in bends), rel=1e-5)
    spread = (lit or 1.0) ** 2 / ((1.0 + away * bends[0]) * (1.0 + away * bends[1]))
    assert found.growth[k] == pytest.approx(spread, rel=1e-4)


def test_a_rod_makes_a_sun_a_line_of_light() -> None:
    rod = {"shape": "cylinder", "base": [0.1, -1, -2], "top": [0.1, 1, -2], "radius": 0.05, "material": MIRROR}
    found = seen(next(polished_faces(plan_of(rod))), np.zeros(3), np.array([0.5, 0.3, np.sqrt(0.66), 0.0]))
    k = int(np.flatnonzero(~found.behind)[0])
    along, across = curvatures(found, k)
    assert along == pytest.approx(0.0, abs=1e-6)
    assert 0.9 < across * np.linalg.norm(found.points[k]) < 1.0


def test_a_near_sphere_has_the_light_of_the_disk_as_which_it_shows() -> None:
    lamp = {
        "shape": "sphere",
        "center": [0, 0, -0.2],
        "radius": 0.02,
        "material": {"kind": "emissive", "radiance": 7.0},
    }
    places, light, _ = points_of(plan_of(lamp).emitters.records[0], np.zeros(3)) or ()
    solid_angle = 2 * np.pi * (1 - np.sqrt(1 - 0.1**2))
    assert light.sum(axis=0) == pytest.approx([7.0 * solid_angle] * 3, rel=0.003)  # 1 + 0.1^2 / 4
    assert places[:, 2] == pytest.approx(-0.2)


def test_metal_and_glass_reflect_as_fresnel_says() -> None:
    gold = {"kind": "conductor", "metal": {"n": [0.2, 0.4, 1.4], "k": [3.0, 2.4, 1.9]}, "alpha": 0.001}
    kinds = gold, {"kind": "dielectric", "index": 1.5}, {"kind": "thin_glass"}, {"kind": "plastic", "reflectance": 0.5}
    one, front = np.ones(1), np.zeros(1, bool)
    found = []
    for kind in kinds:
        materials = plan_of(ball(kind)).materials
        (lobe,) = lobes_of(materials, 0)
        found.append(lobe.reflectance(one, front)[0])
    n, k = np.array(gold["metal"]["n"]), np.array(gold["metal"]["k"])  # type: ignore[index]
    assert found[0] == pytest.approx(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), rel=1e-6)
    assert (*found[1], *found[3]) == pytest.approx([0.04] * 6)
    assert found[2] == pytest.approx(2 * 0.04 / 1.04, rel=1e-6)  # both faces: 2 r / (1 + r)


@pytest.mark.parametrize(
    "material",
    [
        {"kind": "matte", "reflectance": 0.5},
        {"kind": "conductor", "reflectance": 0.9, "alpha": 0.2},
        {"kind": "principled", "roughness": {"kind": "checker", "even": 0.0, "odd": 1.0}},
    ],
)
def test_what_spreads_light_widely_shows_no_lamps(material: dict[str, Any]) -> None:
    assert not list(polished_faces(plan_of(ball(material))))


def test_of_all_that_stands_on_a_way_its_target_alone_does_not_block() -> None:
    balls = [{"shape": "sphere", "center": [0, 0, z], "radius": 0.1, "material": MIRROR} for z in (-1, -2)]
    sheet = {"shape": "mesh", "vertices": [[4, -1, -1], [6, -1, -1], [5, 1, -1]], "faces": [[0, 1, 2]],
             "material": MIRROR}  # fmt: skip
    plan, device = plan_of(*balls, sheet), open_session()
    way, reach, target, blocks = map(np.array, zip(
        (0, 1.5, (-1, -1), True), (0, 1.5, (0, -1), False), (0, 1.5, (1, -1), True), (0, 3, (0, -1), True),
        (0, 3, (1, -1), True), (0, 0.5, (-1, -1), False), (5, 1.5, (-1, -1), True), (5, 1.5, (2, 0), False),
        (5, 1.5, (2, 1), True), (5, 0.5, (-1, -1), False), strict=True,
    ))  # fmt: skip
    origins, down = way[:, None] * [1.0, 0, 0], np.tile([0.0, 0, -1], (len(way), 1))
    dark = occluded(device, plan, SceneBuffers(device, plan), origins, down, reach, target)
    assert dark.tolist() == blocks.tolist()


def test_polished_metal_brings_the_light_of_its_lobe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_highlights, "occluded", lambda *given: np.zeros(len(given[3]), bool))
    alpha, place, intensity = 0.03, np.array([0.4, 0.5, 0.3]), 3.0
    sheet = {"shape": "rectangle", "corner": [-1.0, -1.0, -1.5], "edge_u": [2.0, 0, 0], "edge_v": [0, 2.0, 0],
             "material": {"kind": "conductor", "reflectance": 0.8, "alpha": alpha}}  # fmt: skip
    lamp = {"kind": "point", "position": place.tolist(), "intensity": [intensity] * 3}
    plan = plan_of(sheet, lights=(lamp,))
    front = Front(np.zeros(3), np.zeros((1, 3)), 0.01)
    pencils = highlights(plan, None, None, lamps_among(plan.emitters.records, [], np.zeros(3)), front)  # type: ignore[arg-type]
    assert pencils is not None
    side = np.linspace(-1, 1, 1200)
    x, y = np.meshgrid(side, side)
    at = np.stack([x, y, np.full_like(x, -1.5)], axis=-1)
    to_eye, to_lamp = -at, place - at
    near, far = np.linalg.norm(to_eye, axis=-1), np.linalg.norm(to_lamp, axis=-1)
    half = to_eye / near[..., None] + to_lamp / far[..., None]
    h = half[..., 2] / np.linalg.norm(half, axis=-1)
    d = alpha**2 / (np.pi * (h * h * (alpha**2 - 1) + 1) ** 2)
    total = np.sum(intensity / far**2 * 0.8 * d / 4 / near**2) * (side[1] - side[0]) ** 2
    assert pencils[2].sum(axis=0) == pytest.approx([total] * 3, rel=0.02)


SHAPES = {
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 1,
                  "transform": [{"scale": [0.4, 0.2, 0.3]}, {"rotate": {"axis": [1, 1, 0], "degrees": 40}},
                                {"translate": [0, 0, -2]}]},
    "cone": {"shape": "cone", "base": [0, -0.3, -2], "apex": [0.1, 0.4, -2], "radius": 0.3},
    "disk": {"shape": "disk", "center": [0, -0.3, -2], "normal": [0.15, 0.45, 1.0], "radius": 0.4},
    "box": {"shape": "box", "min": [-0.6, -0.6, -0.2], "max": [0.6, 0.6, 0.2],
            "transform": [{"rotate": {"axis": [1, -0.5, 0], "degrees": -20}}, {"translate": [0, 0, -2]}]},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_what_a_mirror_brings_is_what_a_picture_of_it_shows(shape: str) -> None:
    lamp = {"shape": "sphere", "center": [0.5, 1.2, 0.3], "radius": 0.15,
            "material": {"kind": "emissive", "radiance": 10.0}}  # fmt: skip
    camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, -0.1, -1], "fov_degrees": 60}
    objects = [SHAPES[shape] | {"material": MIRROR}, lamp]
    text = {"camera": camera, "film": {"resolution": [400, 400]}, "objects": objects,
            "environment": {"kind": "constant", "radiance": 0}, "render": {"spp": 32, "max_depth": 2}}  # fmt: skip
    plan, device = make_plan(Scene.model_validate(text)), open_session()
    spots = 1e-5 * np.stack([np.cos(np.arange(8.0)), np.sin(np.arange(8.0)), np.zeros(8)], axis=1)
    lamps = lamps_among(plan.emitters.records[: plan.emitters.count], [], np.zeros(3))
    pencils = highlights(plan, device, SceneBuffers(device, plan), lamps, Front(np.zeros(3), spots, 1e-4))
    assert pencils is not None
    side = np.tan(np.radians(30)) * ((np.arange(400) + 0.5) / 200 - 1)
    x, y = np.meshgrid(side, side)
    solid = (side[1] - side[0]) ** 2 / (1 + x * x + y * y) ** 1.5
    light = (rptcam_cl.render(text).pixels * solid[..., None]).sum(axis=(0, 1))
    assert pencils[2].sum(axis=0) == pytest.approx(light, rel=0.02)
