"""Tables of pupils kept on disk: the same bits as those computed, for the same lens in the same state alone."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core import remember
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from rptcam_cl.optics import irradiance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras import pupil
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.pupil import pupil_sampling
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene

NAME, BACK_MM, HALF_MM, NM = "dgauss-50mm", 38.0, (18.0, 12.0), 550.0
entrance_pupil = sys.modules["rptcam_cl.rendering.cameras.setting"]  # its package has a function of this name


class ComputedError(Exception):
    """Something that was to be kept."""


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    forget()
    yield tmp_path
    forget()


def no_more(monkeypatch):
    """Let nothing be computed from now on."""

    def refuse(*_):
        raise ComputedError

    for name in ("_rear", "_thick", "_bounds", "tight_sampling"):
        monkeypatch.setattr(pupil, name, refuse)
    forget()


@pytest.mark.parametrize("tier", ["rear", "thick", "bounds", "auto"])
def test_tables_come_back_with_the_same_bits(monkeypatch, tier):
    made = pupil_sampling(load_lens(NAME), BACK_MM, HALF_MM, NM, tier)
    no_more(monkeypatch)
    kept = pupil_sampling(load_lens(NAME), BACK_MM, HALF_MM, NM, tier)
    assert kept.table.tobytes() == made.table.tobytes()
    assert not kept.table.flags.writeable
    assert replace(kept, table=made.table) == made
    assert (type(kept.parameters), kept.facts, kept.metadata) == (type(made.parameters), made.facts, made.metadata)


def test_each_state_and_each_lens_has_tables_of_its_own(monkeypatch):
    lens = load_lens(NAME)
    pupil_sampling(lens, BACK_MM, HALF_MM, NM, "rear")
    no_more(monkeypatch)
    changed = replace(lens.surfaces[0], curvature=lens.surfaces[0].curvature * (1 + 1e-15))
    others = [
        (replace(lens, surfaces=(changed, *lens.surfaces[1:])), BACK_MM, HALF_MM, NM, "rear"),
        (lens, BACK_MM + 1e-9, HALF_MM, NM, "rear"),
        (lens, BACK_MM, (18.0, 12.5), NM, "rear"),
        (lens, BACK_MM, HALF_MM, (450.0, 650.0), "rear"),
        (lens, BACK_MM, HALF_MM, NM, "bounds"),
    ]
    for other in others:
        with pytest.raises(ComputedError):
            pupil_sampling(*other)
    pupil_sampling(lens, BACK_MM, HALF_MM, NM, "rear")


def test_changed_code_makes_tables_anew(monkeypatch):
    pupil_sampling(load_lens(NAME), BACK_MM, HALF_MM, NM, "rear")
    no_more(monkeypatch)
    monkeypatch.setattr(remember, "identity_of_code", lambda rooms, kernels: "other code")
    with pytest.raises(ComputedError):
        pupil_sampling(load_lens(NAME), BACK_MM, HALF_MM, NM, "rear")


def test_a_lens_in_colour_is_traced_once_for_all_pictures_in_the_same_state(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene({
        "film": {"resolution": [64, 48], "width_mm": 24},
        "camera": {"kind": "realistic", "lens": "achromat-100mm", "eye": [0, 0, 3], "target": [0, 0, 0],
                   "focus": {"distance_m": 2.9173}},
    })  # fmt: skip
    first = camera_model(scene, lens_colour="on")
    assert first.axial_colour is not None
    for name in ("optics.irradiance.film_irradiance", "rendering.cameras.lens_records._Probe",
                 "rendering.cameras.ray_map.lens_records"):  # fmt: skip
        monkeypatch.setattr(f"rptcam_cl.{name}", None)  # whatever asks again fails
    second = camera_model(scene, lens_colour="on")
    assert second.axial_colour is not None and np.array_equal(first.axial_colour, second.axial_colour)
    assert np.array_equal(first.surfaces, second.surfaces)


@pytest.mark.slow
def test_light_on_the_axis_and_the_drift_of_the_pupil_come_back(monkeypatch):
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1]}
    lens = "anamorphic-100mm"  # the drift of round lenses is found as fast as it is read
    scene = load_scene({"camera": {"kind": "realistic", "lens": lens, "focus": {"distance_m": 2}, **pose}})

    forget()
    made = camera_model(scene)
    assert len(made.metadata["entrance_pupil"]) > 1

    def refuse(*_, **__):
        raise ComputedError

    monkeypatch.setattr(irradiance, "film_irradiance", refuse)
    monkeypatch.setattr(entrance_pupil, "film_chief_rays", refuse)
    forget()
    kept = camera_model(scene)
    assert kept.on_axis_irradiance == made.on_axis_irradiance
    assert kept.metadata == made.metadata
    forget()
    with pytest.raises(ComputedError):
        camera_model(change_scene(scene, camera={"f_number": 8}))
    forget()
