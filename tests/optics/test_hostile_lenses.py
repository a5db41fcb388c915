"""Whatever a lens file says, it loads or is refused in one line; what loads can be traced without NaN."""

import copy

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status

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


@settings(max_examples=100, database=None)
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
