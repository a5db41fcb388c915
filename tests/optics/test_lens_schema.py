"""The JSON schema of lens files: current, and of one mind with the reader."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import lenses_dir
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.files.keys import lens_json_schema, lens_json_schema_text
from rptcam_cl.optics.library import list_lenses, load_lens

SCHEMA = jsonschema.Draft202012Validator(lens_json_schema())


def as_json(value: Any) -> Any:
    """The value as a JSON file would hold it: with text for keys."""
    return json.loads(json.dumps(value))


def lens_with(**surface: Any) -> dict[str, Any]:
    front = {"radius": 50.0, "thickness": 2.0, "glass": {"index": 1.5}, "diameter": 10.0}
    return {"name": "x", "surfaces": [front | surface, {"diameter": 10.0}]}


def test_the_published_schema_is_current(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    published = (checkout / "docs" / "lens.schema.json").read_text("utf-8")
    assert published == lens_json_schema_text(), "write it: rptcam schema --lens > docs/lens.schema.json"
    assert main(["schema", "--lens"]) == 0
    assert capsys.readouterr().out == published


def test_the_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(lens_json_schema())


@pytest.mark.parametrize("name", list_lenses())
def test_bundled_lenses_follow_it(name: str) -> None:
    SCHEMA.validate(as_json(read_yaml(lenses_dir() / f"{name}.yaml").data))


INSIDE = {"thickness_mm": 10, "wavelengths_nm": [400, 700], "values": [0.9, 0.99]}
GOOD = [
    lens_with(aspheric={4: 1e-5, 6: -2e-8}, conic=-1.0),
    lens_with(radius_x=40.0, form="toroid"),
    lens_with(radius_x=40.0, conic_x=-1.0),
    lens_with(cylinder="x"),
    lens_with(decentre=[0.1, 0.2], tilt_degrees=[1, 2, 3]),
    lens_with(clear={"half_plane_degrees": 90}, outside="pass", glass="air"),
    lens_with(clear={"rectangle": [4, 2], "half_plane_degrees": 10, "edge": 0.5}),
    lens_with(stop=True, shape="heart"),
    lens_with(stop=True, shape={"blades": 6, "curvature": 0.5}),
    lens_with(stop=True, shape={"star": 5, "inner": 0.4}),
    lens_with(stop=True, shape={"polygon": [[1, 0], [0, 1], [-0.6, -0.6]]}),
    lens_with(glass={"nd": 1.6, "vd": 40}),
    lens_with(coating="mgf2", glass={"index": 1.5, "transmittance": INSIDE}),
    lens_with(coating={"quarter_wave": {"index": 1.38, "wavelength_nm": 550}}) | {"coating": "bare"},
    lens_with() | {"coating": {"reflectance": 0.005}},
    lens_with(coating={"reflectance": {"wavelengths_nm": [400, 700], "values": [0.01, 0.02]}}),
    lens_with(glass={"linear_abbe": {"n": 1.6, "v": 40}}),
    lens_with(glass={"sellmeier": {"b": [1.0], "c": [0.01]}, "range_nm": [300, 2000]}),
    lens_with(glass={"cauchy": [1.5, 0.004]}),
    lens_with(glass="N-BK7") | {"unit": "cm", "object_medium": "water", "published": {"f_number": 2}},
    lens_with() | {"groups": [{"surfaces": [0, 1], "decentre": [0.1, 0]}]},
    lens_with() | {"configurations": [{"name": "wide", "gaps": {0: 2.5}, "stop_diameter": 3}]},
    lens_with() | {"focusing": {"surfaces": [1, 1], "travel": [-1, 1]}},
    lens_with() | {"focus_drive": {"speed": 30, "acceleration": 600, "source": "measured"}},
]


@pytest.mark.parametrize("lens", GOOD, ids=json.dumps)
def test_both_accept_what_is_right(lens: dict[str, Any]) -> None:
    load_lens(lens)
    SCHEMA.validate(as_json(lens))


BAD = [
    {"name": "x"},
    {"name": "x", "surfaces": []},
    lens_with() | {"surface": 1},
    lens_with() | {"unit": "ft"},
    lens_with() | {"groups": [{"surfaces": [0, 1]}]},
    lens_with() | {"groups": [{"surfaces": [0], "decentre": [0, 1]}]},
    lens_with() | {"configurations": [{"name": "wide"}]},
    lens_with() | {"configurations": [{"name": "wide", "gaps": {0: -1}}]},
    lens_with() | {"focusing": {"surfaces": [1, 1]}},
    lens_with() | {"focus_drive": {"speed": 30}},
    lens_with() | {"focus_drive": {"speed": 0, "acceleration": 600}},
    lens_with(diameter=0),
    lens_with(diameter="wide"),
    lens_with(radius="50"),
    lens_with(stop="yes"),
    lens_with(colour="red"),
    lens_with(aspheric={"four": 1e-5}),
    lens_with(aspheric=[1e-5]),
    lens_with(cylinder="z"),
    lens_with(cylinder="x", radius_x=20.0),
    lens_with(form="toroid"),
    lens_with(radius_x=20.0, form="cone"),
    lens_with(conic_x=1.0),
    lens_with(coating="shiny"),
    lens_with(coating={}),
    lens_with(coating={"reflectance": 1.5}),
    lens_with(coating={"quarter_wave": {"index": 1.38}}),
    lens_with(coating={"quarter_wave": {"index": 1.38, "wavelength_nm": 550}, "reflectance": 0.1}),
    lens_with(glass={"index": 1.5, "transmittance": {"thickness_mm": 1}}),
    lens_with(outside="pass"),
    lens_with(clear={"circle": 1}),
    lens_with(clear={"rectangle": [1]}),
    lens_with(tilt_degrees=[1]),
    lens_with(shape="heart"),
    lens_with(stop=True, shape={"blades": 6, "star": 5}),
    lens_with(stop=True, shape={"blades": 2}),
    lens_with(stop=True, shape="square"),
    lens_with(glass={"index": 9}),
    lens_with(glass={"index": 1.5, "nd": 1.5}),
    lens_with(glass={"nd": 1.5}),
    lens_with(glass={"vd": 50}),
    lens_with(glass={"linear_abbe": {"n": 1.6}}),
    lens_with(glass={"schott": [2.3]}),
    lens_with(glass=1.5),
]


@pytest.mark.parametrize("lens", BAD, ids=json.dumps)
def test_both_refuse_what_is_wrong(lens: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        load_lens(lens)
    with pytest.raises(jsonschema.ValidationError):
        SCHEMA.validate(as_json(lens))
