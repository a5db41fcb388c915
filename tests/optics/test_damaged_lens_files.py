"""Damaged files of other programs load or are refused in one line, with the file's name: never a traceback."""

import copy
import json
import random

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status

from .test_foreign_features import DEEPLENS, FLOAT

ISET_ROW = {"radius": 50, "thickness": 3, "ior": 1.5, "semi_aperture": 5, "conic_constant": 0.1}
SOUND = {
    "a.seq": "RDM;LEN\nTIT 'x'\nEPD 5\nDIM M\nWL 588\nYAN 0 5\nPRV\n PWL 656 588 486\n 'OWN' 1.5 1.51 1.52\nEND\n"
    "SO 0 1E11\nS 50 3 'OWN'\n STO\n CIR 5\n ASP\n"
    " K -0.5\n A 1E-5\n ADE 1; YDE 0.1\nS -50 40 517.642\n CYL\nS 0 1\nSI 0 0\n",
    "a.zmx": FLOAT + "SURF 6\n  TYPE EVENASPH\n  PARM 2 1e-6\n  CONI -1\n",
    "b.json": json.dumps(DEEPLENS),
    "c.json": json.dumps({"name": "x", "surfaces": [ISET_ROW, ISET_ROW | {"ior": [[400, 700], [1.6, 1.5]]}, ISET_ROW]}),
    "a.dat": "# f\n6.0\n8 2 1.6 4\n0 0.5 0 3\n-8 0 1 4\n",
    "a.txt": "[descriptive data]\ntitle\tx\n[variable distances]\n"
    "Focal Length\t50\t70\nF-Number\t2\t3\nMagnification\t0\t0\n"
    "d0\tInfinity\tInfinity\nd2\t3\t5\n[lens data]\n1\t50\t3\t1.6\t20\t50\n"
    "2\t-50\td2\t\t20\n3\tAS\t2\t\t10\n4\t60\t2\t1.5\t20\t60\n"
    "5\t-60\t\t\t20\n[aspherical data]\n1\t50\t0\t1e-6\n",
    "a.agf": "NM N-X 2 517642 1.517 64.2\nCD 1.04 0.006 0.23 0.02 1.01 103\n"
    "LD 0.3 2.5\nIT 0.4 0.99 10\nIT 0.7 0.99 10\n",
    "b.yml": "DATA:\n  - type: formula 2\n    wavelength_range: 0.3 2.5\n    coefficients: 0 1.04 0.006 0.23 0.02\n",
}  # fmt: skip
WORDS = [
    "",
    "x",
    "NaN",
    "1e999",
    "-1",
    "0",
    "1e300",
    "INFINITY",
    "\t",
    "'",
    ";",
    "S",
    "[",
    "{",
    "\x00",
    "é",
    "517.642",
    "&",
]


def damaged(text: str, chance: random.Random) -> bytes:
    """The text with a few words lost, doubled or exchanged, and perhaps its bytes too."""
    words = text.replace("\n", " \n ").replace("\t", " \t ").split(" ")
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(words))
        what = chance.randrange(4)
        words[place : place + 1] = [[], [chance.choice(WORDS)], [words[place]] * 2, [words[place][:-1]]][what]
    joined = " ".join(words).replace(" \t ", "\t").replace(" \n ", "\n")
    raw = joined.encode(chance.choice(["utf-8", "utf-8", "utf-16", "latin-1"]), "replace")
    return raw[: chance.randrange(len(raw))] if chance.random() < 0.2 else raw


@pytest.mark.parametrize("name", [name for name in SOUND if name not in ("a.agf", "b.yml")])
def test_sound_files_load(tmp_path, name):
    (tmp_path / name).write_text(SOUND[name])
    assert load_lens(tmp_path / name).surfaces


@pytest.mark.parametrize("name", SOUND)
def test_damaged_files_load_or_are_refused_in_one_line(tmp_path, name):
    chance = random.Random(name)
    path = tmp_path / name
    law = {"a.agf": {"catalogue": name, "name": "N-X"}, "b.yml": {"refractiveindex": name}}.get(name)
    user = tmp_path / "user.json"
    rows = [{"radius": 50, "thickness": 3, "diameter": 9, "glass": law}, {"diameter": 9}]
    user.write_text(json.dumps({"name": "user", "surfaces": rows}))
    refused = 0
    for _ in range(60):
        path.write_bytes(damaged(SOUND[name], chance))
        try:
            lens = load_lens(user if law else path)
        except InputError as error:
            assert "\n" not in str(error) and (name in str(error) or "user.json" in str(error))
            refused += 1
            continue
        assert lens.surfaces
    assert refused > 5


BASE = {
    "name": "base",
    "surfaces": [
        {"radius": 50.0, "thickness": 5.0, "glass": {"nd": 1.5168, "vd": 64.2}, "diameter": 20.0},
        {"radius": -50.0, "thickness": 3.0, "diameter": 20.0, "conic": -0.5, "aspheric": {4: 1e-5}},
        {"stop": True, "thickness": 4.0, "diameter": 9.0},
        {"radius": 80.0, "diameter": 20.0, "cylinder": "x"},
    ],
}
NUMBERS = st.one_of(
    st.sampled_from([0, -1, 1, 1e-300, 1e300, 1e-12, 1e12, -0.0, float("nan"), float("inf"), float("-inf"), 2**70]),
    st.floats(-1e4, 1e4),
)
VALUES = st.one_of(
    NUMBERS,
    st.none(),
    st.booleans(),
    st.text(max_size=5),
    st.lists(NUMBERS, max_size=3),
    st.dictionaries(st.text(max_size=4), NUMBERS, max_size=2),
)
KEYS = (
    "radius",
    "thickness",
    "glass",
    "diameter",
    "conic",
    "aspheric",
    "cylinder",
    "stop",
    "radius_x",
    "tilt_degrees",
    "clear",
    "shape",
    "extra",
)


@settings(max_examples=30, database=None)
@seed(4)
@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from(KEYS), VALUES), min_size=1, max_size=4))
def test_mutated_lenses_load_or_are_refused(changes):
    data = copy.deepcopy(BASE)
    for index, key, value in changes:
        data["surfaces"][index][key] = value
    try:
        lens = load_lens(data)
    except InputError as error:
        assert "\n" not in str(error)
        return
    rng = np.random.default_rng(1)
    with np.errstate(all="ignore"):
        origins = np.column_stack([rng.uniform(-12, 12, (50, 2)), np.full(50, lens.length + 30)])
        rays = lens.trace(origins, np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), np.full(50, -1.0)]))
    assert np.all(np.isfinite(rays.origins)) and np.all(np.isfinite(rays.directions))
    assert set(np.unique(rays.status)) <= {int(status) for status in Status}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rays_that_are_not_finite_are_missed(bad):
    lens = load_lens("dgauss-50mm")
    rays = lens.trace([[0, 0, 68.0], [bad, 0, 68], [0, 0, bad]], [[bad, 0, -1], [0, 0, -1], [0, 0, -1]])
    assert rays.status.tolist() == [Status.missed] * 3
    zero = lens.trace([[0, 0, 68.0]], [[0, 0, 0.0]])
    assert zero.status.tolist() == [Status.missed]
