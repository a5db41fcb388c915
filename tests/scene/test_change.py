from pathlib import Path

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import change_scene

from .conftest import EVERYTHING, SMALL, Load


def test_changed_scene_is_a_copy(load: Load) -> None:
    scene = load(SMALL)
    changed = change_scene(scene, film={"resolution": (100, 50)}, render={"spp": 3, "seed": 9})
    assert (changed.film.resolution, changed.render.spp, changed.render.seed) == ((100, 50), 3, 9)
    assert (scene.film.resolution, scene.render.spp, scene.render.seed) == ((640, 360), 64, 0)
    assert changed.render.max_depth == scene.render.max_depth


def test_change_is_the_same_as_an_override(load: Load) -> None:
    changed = change_scene(load(EVERYTHING), film={"crop": (0, 1, 0, 0.5)}, camera={"f_number": 8})
    assert changed.content_hash() == load(EVERYTHING, "film.crop=[0, 1, 0, 0.5]", "camera.f_number=8").content_hash()


def test_objects_and_folders_stay_the_same(tmp_path: Path, load: Load) -> None:
    scene = load(EVERYTHING)
    changed = change_scene(scene, render={"spp": 3})
    assert all(new is old for new, old in zip(changed.objects, scene.objects, strict=True))
    assert changed.base_dir == tmp_path


def test_wrong_change_is_refused(load: Load) -> None:
    with pytest.raises(InputError, match=r"^film\.resolution\[0\]: is out of range \(got 0; allowed: at least 1\)$"):
        change_scene(load(SMALL), film={"resolution": (0, 50)})
    with pytest.raises(InputError, match=r"^film\.resolution: .*would need a film of"):
        change_scene(load(SMALL), film={"resolution": (10**6, 10**6)})
    with pytest.raises(InputError, match=r"^film\.resolution: does not fit an environment camera"):
        change_scene(load(SMALL.replace("pinhole", "environment").replace(", fov_degrees: 40", "")
                          + "film: {resolution: [64, 32]}\n"), film={"resolution": (64, 64)})  # fmt: skip
