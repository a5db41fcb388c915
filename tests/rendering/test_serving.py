"""Kernels of a scene with more in it do for one with less: to the bit, or on average where light is found otherwise."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import Plan, make_plan, serve
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.progressive import FilmRun
from rptcam_cl.rendering.tracer import WavefrontPool
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.conftest import PLAIN_KINDS, known_of
from tests.rendering.pictures import MATTE, WHITE, bits, lamp, looking, scene_of
from tests.rendering.test_furnaces import CONVEX
from tests.rendering.test_world import still_life
from tests.support.cases import fast
from tests.support.statistics import assert_same_tiles, sampled

SCENE: dict[str, Any] = {
    "film": {"resolution": [24, 16]},
    "camera": {"kind": "pinhole", "fov_degrees": 60, "eye": [0, 0, 3], "target": [0, 0, 0]},
    "render": {"spp": 4, "max_depth": 3},
    "materials": {
        "floor": {"kind": "matte", "reflectance": {"kind": "checker", "even": 0.8, "odd": 0.2}},
        "bulb": {"kind": "emissive", "radiance": 4},
        "panel": {"kind": "emissive", "radiance": 3},
    },
    "objects": [
        {"shape": "rectangle", "corner": [-2, -1, -2], "edge_u": [4, 0, 0], "edge_v": [0, 0, 4], "material": "floor"},
        {"shape": "sphere", "center": [-1, 0, 0], "radius": 0.2, "material": "bulb"},
        {"shape": "disk", "center": [0.7, 1.2, 0], "normal": [0, -1, 0], "radius": 0.4, "material": "panel"},
    ],
    "environment": {"kind": "image", "file": str(Path(__file__).parents[2] / "docs" / "images" / "boards.png")},
}  # fmt: skip
BULB, PANEL, SKY = {"materials.bulb.radiance": 0}, {"materials.panel.radiance": 0}, {"environment.gain": 0}
TREE = [
    SCENE["objects"][1] | {"center": [x / 4 - 1, -0.7, z / 4 - 1], "radius": 0.05} for x in range(9) for z in range(9)
]


def scene_with(changes: dict[str, Any], **more: Any) -> Scene:
    folders = [Path(__file__).parents[2]]
    return set_keys(load_scene(SCENE | more, allow_folders=folders), changes)


def film(session: Session, scene: Scene, plan: Plan, first: int = 0) -> np.ndarray[Any, Any]:
    pool = WavefrontPool(session)
    settings = scene.render.model_copy(update={"seed": first})
    run = FilmRun(pool.wavefront(plan, pool.upload(plan), FilmLayout.of(scene.film), settings, "film"))
    run.add(scene.render.spp)
    return run.pixels()


def served(scene: Scene, facts: dict[str, int]) -> Plan | None:
    parts = PlanParts()
    parts.held = facts
    return serve(make_plan(scene, parts=parts), facts)


def test_kernels_serve_a_scene_without_some_of_its_lamps_to_the_bit(session: Session) -> None:
    facts = make_plan(scene_with({})).facts
    scene = scene_with(BULB | {"objects.0.material": {"kind": "matte", "reflectance": 0.6}})
    exact = make_plan(scene)
    plan = serve(exact, facts)
    assert plan is not None
    assert plan.facts == facts != exact.facts
    assert np.array_equal(film(session, scene, plan), film(session, scene, exact))


def test_the_lamp_that_stands_where_there_is_none_is_none_that_shines() -> None:
    scene = scene_with(BULB | PANEL | SKY)
    plan = served(scene, make_plan(scene_with({})).facts)
    assert plan is not None
    assert plan.emitters.count == 1
    assert not len(plan.emitters.shining)  # of which ghosts and diffraction would make light of


@pytest.mark.slow
@pytest.mark.parametrize("changes", [PANEL, SKY, BULB | PANEL, BULB | SKY, BULB | PANEL | SKY], ids=str)
def test_kernels_serve_a_scene_without_lamps_or_sky_to_the_bit(session: Session, changes: dict[str, Any]) -> None:
    facts = make_plan(scene_with({})).facts
    scene = scene_with(changes)
    plan = served(scene, facts)
    assert plan is not None
    assert np.array_equal(film(session, scene, plan), film(session, scene, make_plan(scene)))


@pytest.mark.slow
@pytest.mark.parametrize("tree_first", [True, False])
def test_kernels_that_pick_lamps_in_another_way_serve_on_average(session: Session, tree_first: bool) -> None:
    many, few = scene_with({}, objects=SCENE["objects"] + TREE), scene_with({})
    assert make_plan(many).facts["LIGHT_TREE"] > make_plan(few).facts["LIGHT_TREE"]
    first, scene = (many, few) if tree_first else (few, many)
    scene = set_keys(scene, {"render.spp": 64})
    facts, exact = (
        make_plan(first).facts | {"FEW_PRIMITIVES": make_plan(scene).facts["FEW_PRIMITIVES"]},
        make_plan(scene),
    )
    plan = served(scene, facts)
    assert plan is not None
    assert plan.facts["LIGHT_TREE"] != exact.facts["LIGHT_TREE"]
    pictures = [[film(session, scene, each, seed) for seed in range(16)] for each in (plan, exact)]
    assert_same_tiles(*map(sampled, pictures))


def test_kernels_do_not_serve_what_they_do_not_know() -> None:
    facts = make_plan(scene_with(BULB)).facts
    assert serve(make_plan(scene_with({})), facts) is None
    assert served(scene_with({}), facts) is None
    assert served(scene_with({"spectrum": {"mode": "spectral"}}), facts) is None


def body(shape: str, **material: Any) -> dict[str, Any]:
    return {"environment": WHITE, "objects": [CONVEX[shape] | {"material": MATTE | material}]}


def lit_by(kind: str | None = None, shape: str = "", **light: Any) -> dict[str, Any]:
    floor = CONVEX["plane"] | {"material": MATTE}
    if kind is None:
        return {"objects": [floor, CONVEX[shape] | {"material": lamp(2.0)}]}
    return {"objects": [floor], "lights": [{"kind": kind, **light}]}


PATTERNS = {
    "checker": {"even": 0.8, "odd": 0.2},
    "grid": {"background": 0.8, "line": 0.2, "line_width": 0.1},
    "gradient": {"start": 0.8, "end": 0.2},
}
# Scenes with one of the kinds that kernels of fast tests may know of, and their facts of `PLAIN_KINDS`.
ALONE = {
    "sphere": (body("sphere"), "MATTE SPHERE"),
    **{shape: (body(shape), f"MATTE AFFINE {shape.upper()} {'DISK' if 'capped' in CONVEX[shape] else ''}")
       for shape in CONVEX if shape != "sphere"},
    **{kind: (body("sphere", kind=kind), f"{kind.upper()} SPHERE") for kind in ("mirror", "dielectric")},
    **{kind: (body("sphere", reflectance={"kind": kind} | keys), f"MATTE SPHERE TEXTURE {kind.upper()}")
       for kind, keys in PATTERNS.items()},
    **{f"lamp of a {shape}": (lit_by(shape=shape), f"MATTE PLANE AFFINE {shape.upper()} {kinds}")
       for shape, kinds in (("sphere", "SPHERES"), ("rectangle", "FLATS"), ("disk", "DISKS FLATS"))},
    "point": (lit_by("point", position=[0, -2, 3], intensity=9), "MATTE PLANE AFFINE POINTS SIZELESS"),
    "sun": (lit_by("directional", direction=[0, 1, -1], irradiance=1), "MATTE PLANE AFFINE DIRECTIONS"),
}  # fmt: skip


def alone(name: str) -> dict[str, Any]:
    return scene_of([], looking([0.4, -3, 0.8], [0, 0, 0]), depth=3) | ALONE[name][0]


@pytest.mark.parametrize("name", ALONE)
def test_a_plan_knows_of_the_kinds_that_its_scene_has_and_of_no_others(name: str) -> None:
    facts = make_plan(load_scene(alone(name))).facts
    assert {each.partition("_")[2] for each in PLAIN_KINDS if facts[each]} == set(ALONE[name][1].split())


@pytest.mark.parametrize("name", fast(["lamp of a sphere"], [*ALONE, "everything"]))
def test_kernels_that_know_of_more_have_the_bits_of_those_that_know_of_no_more(
    name: str, own_kernels: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, films, take = still_life() if name == "everything" else alone(name), [], Session.program
    for _ in range(2):
        session = Session(choose_device())
        films.append(bits(rptcam_cl.render(scene, spp=2, device=session)))
        monkeypatch.setattr(
            Session,
            "program",
            lambda self, files, facts, more: take(self, files, known_of(files, facts, PLAIN_KINDS), more),
        )
    assert films[0] == films[1]
