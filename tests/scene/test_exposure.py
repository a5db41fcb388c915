"""The key `exposure`: words and mappings, and what is refused."""

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene

from .conftest import EVERYTHING, SMALL, Load

NO_LENS = "without a lens opening"


@pytest.mark.parametrize("mode", ["relative", "irradiance", "physical", "auto"])
def test_word_is_the_mapping_of_its_mode(load: Load, mode: str) -> None:
    word, mapping = (load(EVERYTHING, f"exposure={text}") for text in (mode, f"{{mode: {mode}}}"))
    assert word.exposure == mapping.exposure
    assert word.content_hash() == mapping.content_hash()


def test_keys_can_be_set_beside_a_word(load: Load) -> None:
    scene = load(EVERYTHING, "exposure=physical", "exposure.iso=400", "shutter.time_s=1/125")
    assert (scene.exposure.mode, scene.exposure.iso, scene.shutter.time_s) == ("physical", 400, 1 / 125)


def test_every_key_that_changes_the_film_changes_the_hash(load: Load) -> None:
    settings = ["exposure.iso=200", "exposure.ev=1", "exposure.neutral_density_stops=1", "shutter.time_s=1"]
    hashes = {load(EVERYTHING, "exposure=physical", text).content_hash() for text in settings}
    hashes |= {load(EVERYTHING, "exposure=auto", text).content_hash() for text in ("exposure.target=1", "picture.ev=1")}
    assert len(hashes) == 6


def test_scene_with_an_exposure_survives_the_way_to_data_and_back(load: Load) -> None:
    scene = load(EVERYTHING, "exposure=auto", "exposure.metering=spot")
    assert load_scene(scene.model_dump(), base_dir=scene.base_dir).exposure == scene.exposure
    assert change_scene(scene, exposure={"ev": 1.0}).exposure.metering == "spot"


@pytest.mark.parametrize(("text", "overrides", "message"), [
    (SMALL, "exposure=physical", f"exposure: needs the irradiance of a film, and a camera of kind pinhole {NO_LENS}"),
    (SMALL, "exposure=irradiance", "allowed: relative or auto; {mode: irradiance, f_number: 8}"),
    (SMALL, "exposure=auto exposure.iso=200", f"exposure.iso: means nothing for a camera of kind pinhole {NO_LENS}"),
    (EVERYTHING, "exposure=physical exposure.f_number=8", "exposure.f_number: is for cameras without a lens opening"),
    (EVERYTHING, "exposure.iso=200", "exposure.iso: means nothing with mode irradiance (got 200; allowed: mode"),
    (EVERYTHING, "exposure=physical exposure.target=0.5", "exposure.target: means nothing with mode physical"),
    (EVERYTHING, "exposure=auto exposure.spot_at=[0,0]", "exposure.spot_at: places a spot (got [0, 0]; allowed:"),
    (EVERYTHING, "exposure=auto exposure.metering=center", "exposure.metering: is not a known choice"),
    (EVERYTHING, "exposure=physical exposure.iso=0", "exposure.iso: is out of range (got 0; allowed: at least 1e-06)"),
    (EVERYTHING, "exposure.neutral_density_stops=-1", "is out of range (got -1; allowed: at least 0)"),
    (EVERYTHING, "exposure=fysical", "exposure: is not a known choice; did you mean physical? (got 'fysical'"),
    (EVERYTHING, "exposure=3", "exposure: must be a mapping (got 3; allowed: a mapping with the keys mode, iso"),
])  # fmt: skip
def test_exposure_is_refused_with_its_reason(load: Load, text: str, overrides: str, message: str) -> None:
    with pytest.raises(InputError, match=r"^--set exposure") as caught:
        load(text, *overrides.split())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_thin_lens_of_no_size_counts_as_a_pinhole(load: Load) -> None:
    lens = "kind: thin_lens, fov_degrees: 40, aperture_radius_m: 0, focus_distance_m: 5"
    thin = f"camera={{{lens}, eye: [0, 1, 5], target: [0, 1, 0]}}"
    with pytest.raises(InputError, match=NO_LENS):
        load(SMALL, thin, "exposure=physical")
    assert load(SMALL, thin, "exposure={mode: physical, f_number: 4}").exposure.f_number == 4
