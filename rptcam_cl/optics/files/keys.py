"""Every key of our lens form, declared once: what may stand in a file, what it means, and its JSON schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rptcam_cl.core.records import MOST_LAYERS
from rptcam_cl.core.strict_yaml import NUMBER, POSITIVE, TEXT, Key, by_number, mapping, numbers
from rptcam_cl.optics.shapes import FORMS, PHASES

#
# Every key of our lens form, declared once: what may stand in a file, what it means, and its JSON schema.
#
# The readers take their allowed keys from here, and so does `lens_json_schema`.

UNITS_MM = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "in": 25.4, "km": 1e6}
HIGHEST_POWER = 40
LOWEST_INDEX, HIGHEST_INDEX = 0.5, 5.0
SHORTEST_MM, LONGEST_MM = 1e-9, 1e15  # beyond these, squares and reciprocals leave the range of numbers


INDEX = {"type": "number", "minimum": LOWEST_INDEX, "maximum": HIGHEST_INDEX}
_SPAN = {"type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 2, "maxItems": 2}
_GLASS_VALUE = {"$ref": "#/$defs/Glass"}
GAPS = by_number({"type": "number", "minimum": 0}, minProperties=1)

LINEAR_ABBE = {
    "n": Key("Index at 589.3 nm.", INDEX),
    "v": Key("Abbe number.", POSITIVE),
}

SELLMEIER = {
    "b": Key("Strengths.", numbers(1)),
    "c": Key("Squared wavelengths of resonance [um^2], as many as b.", numbers(1)),
    "c0": Key("A constant added to 1; 0 by default.", NUMBER),
}

INDEX_TABLE = {
    "wavelengths_nm": Key("Rising wavelengths [nm].", numbers(1)),
    "values": Key("Index at each; straight lines join them.", {"type": "array", "items": INDEX, "minItems": 1}),
}


LAWS = {
    "index": Key("The same index at every wavelength.", INDEX),
    "nd": Key("Index at 587.56 nm, with vd: a two-term Cauchy law through both.", INDEX),
    "linear_abbe": Key("Index linear in wavelength, after the rptcam paper.", mapping(LINEAR_ABBE, ("n", "v"))),
    "sellmeier": Key("n^2 = 1 + c0 + sum of b L^2 / (L^2 - c), L in um.", mapping(SELLMEIER, ("b", "c"))),
    "cauchy": Key("n = a + b / L^2 + c / L^4 + ..., L in um.", numbers(1)),
    "schott": Key("n^2 = a0 + a1 L^2 + a2 / L^2 + ... + a5 / L^8, L in um.", numbers(6, 6)),
    "table": Key("Measured indices.", mapping(INDEX_TABLE, ("wavelengths_nm", "values"))),
    "catalogue": Key("A Zemax catalogue (.agf) beside the lens file; name picks the glass.", TEXT),
    "refractiveindex": Key("A file of refractiveindex.info beside the lens file.", TEXT),
}

SHARES = {"type": "array", "items": {"type": "number", "minimum": 0, "maximum": 1}, "minItems": 2}
REFLECTANCE = {
    "wavelengths_nm": Key("Rising wavelengths [nm].", numbers(2)),
    "values": Key("Share of the light at each, 0 to 1.", SHARES),
}
TRANSMITTANCE = REFLECTANCE | {"thickness_mm": Key("Length of the way in the glass [mm].", POSITIVE)}

QUARTER_WAVE = {
    "index": Key("Index of the layer.", {"type": "number", "minimum": 1, "maximum": HIGHEST_INDEX}),
    "wavelength_nm": Key("Four times its index times its thickness [nm].", POSITIVE),
}

LAYER = {
    "index": Key(
        "Index of the layer, from 1 if it is clear.",
        {"type": "number", "exclusiveMinimum": 0, "maximum": HIGHEST_INDEX},
    ),
    "extinction": Key(
        "k of its index n + i k, above 0 where it absorbs.", {"type": "number", "minimum": 0, "maximum": 20}
    ),
    "thickness_nm": Key("Of the layer [nm].", POSITIVE),
}

COATING = {
    "quarter_wave": Key("A single layer.", mapping(QUARTER_WAVE, ("index", "wavelength_nm"))),
    "layers": Key(
        "Several layers, from the medium of the lower index, such as air, to that of the higher.",
        {"type": "array", "items": mapping(LAYER, ("index", "thickness_nm")), "minItems": 1, "maxItems": MOST_LAYERS},
    ),
    "reflectance": Key(
        "Measured at normal incidence: a number, a spectrum, or a CSV file of wavelength and reflectance.",
        {"oneOf": [{"type": "number", "minimum": 0, "exclusiveMaximum": 1}, TEXT,
                   mapping(REFLECTANCE, ("wavelengths_nm", "values"))]},
    ),
}  # fmt: skip
COATING_WORDS = ("bare", "mgf2", "multi")
_COATING_VALUE = {"$ref": "#/$defs/Coating"}

THERMAL = {
    "d": Key("Schott's D0, D1, D2 of dn/dT [1/K, 1/K^2, 1/K^3].", numbers(3, 3)),
    "e": Key("Schott's E0 and E1 [um^2/K, um^2/K^2].", numbers(2, 2)),
    "resonance_um": Key("Schott's lambda_TK [um].", POSITIVE),
    "reference_c": Key("Temperature of the index, from which they count [degrees Celsius]; 20 by default.", NUMBER),
}

GLASS = LAWS | {
    "vd": Key("Abbe number, beside nd.", POSITIVE),
    "transmittance": Key(
        "Internal transmittance, surfaces left out, over a thickness.",
        mapping(TRANSMITTANCE, ("thickness_mm", "wavelengths_nm", "values")),
    ),
    "thermal": Key("How heat changes the index.", mapping(THERMAL, ("d", "e", "resonance_um"))),
    "expansion_per_k": Key("Linear expansion [1/K].", NUMBER),
    "range_nm": Key("Shortest and longest wavelength at which the law holds [nm].", numbers(2, 2)),
    "name": Key("Label; of a catalogue the glass.", TEXT),
}

SHAPE = {
    "blades": Key("Number of blades.", {"type": "integer", "minimum": 3}),
    "star": Key("Number of points of a star.", {"type": "integer", "minimum": 2}),
    "polygon": Key("Corners [x, y] in units of the stop's radius.", {"type": "array", "items": numbers(2, 2)}),
    "rotation_degrees": Key("Turn of the blades or the star.", NUMBER),
    "curvature": Key("Of the blades: 0 straight to 1 round.", {"type": "number", "minimum": 0, "maximum": 1}),
    "inner": Key("Of a star: its inner over its outer radius.", POSITIVE),
}

CLEAR = {
    "rectangle": Key("Width and height [unit].", {"type": "array", "items": POSITIVE, "minItems": 2, "maxItems": 2}),
    "centre": Key("[x, y] of the rectangle and the circles [unit]; the axis by default.", numbers(2, 2)),
    "diameter": Key("Of a circle [unit].", POSITIVE),
    "inner_diameter": Key("Of a circle within which light is blocked [unit].", POSITIVE),
    "half_plane_degrees": Key("Direction from the axis into the half plane, from +x towards +y.", NUMBER),
    "edge": Key("Distance of the half plane's edge from the axis [unit]; 0 by default.", NUMBER),
}

QCON = {
    "radius": Key("Distance from the axis at which u is 1 [unit].", POSITIVE),
    "coefficients": Key("a_0, a_1, ... of the sum u^4 a_m Q_m(u^2) [unit].", numbers(1, (HIGHEST_POWER - 2) // 2)),
}

POSE = {
    "decentre": Key("[x, y] or [x, y, z] by which the vertex is moved [unit].", numbers(2, 3)),
    "tilt_degrees": Key("Turns about x, then y, then z, right handed.", numbers(2, 3)),
}

_SHAPED = {
    "shape": Key(
        "Shape of the stop: heart, or one of blades, star and polygon.",
        {"oneOf": [{"const": "heart"}, *(mapping(SHAPE, (kind,)) for kind in ("blades", "star", "polygon"))]},
    ),
    "conic": Key("k: 0 sphere, -1 paraboloid, below -1 hyperboloid.", NUMBER),
    "aspheric": Key(
        f"Powers of r from 1 to {HIGHEST_POWER} and their coefficients [unit^(1 - power)].", by_number(NUMBER)
    ),
    "qcon": Key("Forbes's Qcon polynomials, added to the rest.", mapping(QCON, ("radius", "coefficients"))),
    "cylinder": Key("The only axis along which the surface curves.", {"enum": ["x", "y"]}),
    **{name: key for form in FORMS for name, key in form.keys.items()},
    **{kind.key: Key(f"That it is {kind.description}.", mapping(kind.keys, kind.needs)) for kind in PHASES},
    **POSE,
    "clear": Key("Part of the surface that light may cross.", mapping(CLEAR)),
    "outside": Key("Beyond clear: block, or pass where there is no glass.", {"enum": ["block", "pass"]}),
}

SURFACE = {
    "radius": Key("Of curvature [unit], positive when the centre lies on the film side; a plane by default.", NUMBER),
    "thickness": Key(
        "To the next vertex [unit], negative where a mirror has sent the light back; required but on the last surface.",
        NUMBER,
    ),
    "glass": Key("What fills the space behind the surface; air by default.", _GLASS_VALUE),
    "mirror": Key("Whether the surface reflects; the light stays in the medium it comes from.", {"type": "boolean"}),
    "body_expansion_per_k": Key("Linear expansion of the body that carries a mirror in air [1/K].", NUMBER),
    "diameter": Key("Full clear diameter [unit].", POSITIVE),
    "inner_diameter": Key("Of a hole or an obstruction in the middle, which stops light [unit].", POSITIVE),
    "stop": Key("Whether this is the aperture stop; at most one is.", {"type": "boolean"}),
    "coating": Key("What lies on the surface; as the lens says by default.", _COATING_VALUE),
    **_SHAPED,
}

GROUP = {"surfaces": Key("First and last surface, counted from 0.", _SPAN), **POSE}

FLOATING = {
    "distance": Key("From the object plane to the film [unit].", POSITIVE),
    "gaps": Key("Thickness [unit] behind surfaces, by their number; every state gives the same ones.", GAPS),
    "film_shift": Key(
        "How much farther the film is from the last surface than at infinity [unit], 0 where neither moves; the film"
        " follows the image by default.",
        NUMBER,
    ),
}
STATES = {"type": "array", "items": mapping(FLOATING, ("distance", "gaps"))}

CONFIGURATION = {
    "name": Key("What the position is called.", TEXT),
    "gaps": Key("Thickness [unit] behind surfaces, by their number; every position gives the same ones.", GAPS),
    "stop_diameter": Key("Diameter of the stop in this position, where it differs [unit].", POSITIVE),
    "floating": Key("Gaps at nearer distances in this position.", STATES),
}

FOCUSING = {
    "surfaces": Key("First and last surface of the group that moves, counted from 0.", _SPAN),
    "travel": Key("Least and greatest shift towards the film [unit].", numbers(2, 2)),
}

FOCUS_DRIVE = {
    "speed": Key("At most, of what moves to focus [unit/s].", POSITIVE),
    "acceleration": Key("At most [unit/s^2].", POSITIVE),
    "source": Key("Where the figures come from.", TEXT),
}

LENS = {
    "name": Key("What the lens is called.", TEXT),
    "source": Key("Where its numbers come from.", TEXT),
    "published": Key("What the source claims, such as focal_length_mm and f_number.", {"type": "object"}),
    "marked_f_number": Key(
        "F-number that is engraved on the lens, which means its full opening; published.f_number or that of the name by"
        " default.",
        POSITIVE,
    ),
    "unit": Key("Of all lengths; mm by default.", {"enum": list(UNITS_MM)}),
    "fold": Key(
        "Of a lens whose axis mirrors fold: how the axes of the scene stand in those of the lens, whose z is that of"
        " the film.",
        mapping(POSE, minProperties=1),
    ),
    "object_medium": Key("Glass in front of the lens; air by default.", _GLASS_VALUE),
    "coating": Key("Of every surface between glass and air that has none of its own; bare by default.", _COATING_VALUE),
    "surfaces": Key(
        "The surfaces, scene side first.", {"type": "array", "items": {"$ref": "#/$defs/Surface"}, "minItems": 1}
    ),
    "groups": Key(
        "Surfaces moved and turned together, about the vertex of the first.",
        {"type": "array", "items": mapping(GROUP, ("surfaces",), anyOf=[{"required": [key]} for key in POSE])},
    ),
    "configurations": Key("Positions of a zoom lens.", {"type": "array", "items": mapping(CONFIGURATION, ("gaps",))}),
    "focusing": Key("A group that moves to focus.", mapping(FOCUSING, ("surfaces", "travel"))),
    "floating": Key(
        "Gaps at nearer distances, of groups that each move their own way to focus.",
        STATES,
    ),
    "focus_drive": Key(
        "How fast it focuses by itself, for continuous autofocus; by default as usual lenses do.",
        mapping(FOCUS_DRIVE, ("speed", "acceleration")),
    ),
}


# The JSON schema of lens files, for editors, from the declarations that the readers check by.


def lens_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a lens file in our own form (draft 2020-12)."""
    of_forms = {key: beside for form in FORMS for key, beside in form.needs.items()}
    needs = {"outside": ["clear"], **of_forms, "shape": ["stop"]}
    surface = mapping(SURFACE, ("diameter",), dependentRequired=needs)
    surface["not"] = {"required": ["cylinder", "radius_x"]}
    coating = mapping(COATING, minProperties=1, maxProperties=1)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Lens",
        "description": "A lens: its surfaces from the scene to the film.",
        **mapping(LENS, ("surfaces",)),
        "$defs": {"Glass": glass_json_schema(GLASS), "Surface": surface,
                  "Coating": {"oneOf": [{"enum": list(COATING_WORDS)}, coating]}},
    }  # fmt: skip


def glass_json_schema(keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return the JSON schema of a glass that is a name or a mapping with these keys."""
    one_law = [{"required": [law]} for law in LAWS]
    written = mapping(keys, oneOf=one_law, dependentRequired={"nd": ["vd"], "vd": ["nd"], "catalogue": ["name"]})
    return {"oneOf": [{"type": "string"}, written]}


def lens_json_schema_text() -> str:
    """Return the JSON schema as the text of `docs/lens.schema.json`."""
    return json.dumps(lens_json_schema(), indent=1, ensure_ascii=False) + "\n"
