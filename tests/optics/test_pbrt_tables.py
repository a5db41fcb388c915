"""Four-column lens tables: both meanings of the second column, line ends, and what is refused."""

import json

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens

# Radius, thickness to the next row, index, diameter (dgauss.50mm.dat).
TO_NEXT = """\
# D-GAUSS F/2 22deg HFOV
# US patent 2,673,491 Tronnier
# radius\taxpos\tN\taperture
29.475\t3.76\t1.67\t25.2
84.83\t0.12\t1\t25.2
19.275\t4.025\t1.67\t23
40.77\t3.275\t1.699\t23
12.75\t5.705\t1\t18
0\t4.5\t0\t17.1
-14.495\t1.18\t1.603\t17
40.77\t6.065\t1.658\t20
-20.385\t0.19\t1\t20
437.065\t3.22\t1.717\t20
-39.73\t0\t1\t20
"""

# Radius, gap from the previous row, index, diameter (wide.dat, fisheye.dat and telephoto.dat of 100 mm).
FROM_PREVIOUS = {
    "wide-22mm": """163.579 0 1.54 107.8
53.169 5.529 1 81.8
59.487 45.435 1.772 56.2
-102.877 23.301 1.617 44.6
322.991 8.042 1 41.6
0 3.72 0 39.8
-43.572 10.353 1.617 37.2
-51.312 11.057 1 41.6
-758.075 .523 1.713 48.4
-34.505 14.073 1.805 52
-76.21 6.031 1 55.8
-35.013 18.094 1.617 61
-54.424 5.529 1 81.8""",
    "fisheye-10mm": """302.249 0 1.62 303.4
113.931 8.335 1 206.8
752.019 74.136 1.639 178
83.349 10.654 1 134.2
95.882 111.549 1.654 90.2
438.677 20.054 1 81.4
0 53.895 0 60.8
294.541 14.163 1.517 59.6
-52.265 21.934 1.805 58.4
-142.884 9.714 1 59.6
-223.726 .627 1.673 59.6
-150.404 9.4 1 65.2""",
    "telephoto-250mm": """21.851 0 1.529 19
-34.546 5.008 1.599 17.8
108.705 1.502 1 16.6
0 1.127 0 16.2
-12.852 26.965 1.613 12.6
19.813 1.502 1.603 13.4
-20.378 5.008 1 14.8""",
}


def load_text(tmp_path, text, name="lens.dat"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_lens(path)


def test_thickness_to_the_next_row(tmp_path):
    lens = load_text(tmp_path, TO_NEXT)
    reference = load_lens("dgauss-50mm")
    np.testing.assert_array_equal(lens.vertices, reference.vertices)
    assert lens.stop_index == 5
    assert lens.first_order() == reference.first_order()


def test_gap_from_the_previous_row(tmp_path):
    rows = [line.split() for line in TO_NEXT.splitlines() if not line.startswith("#")]
    gaps = ["0", *(row[1] for row in rows[:-1])]
    text = "\n".join(" ".join([row[0], gap, *row[2:]]) for row, gap in zip(rows, gaps, strict=True))
    np.testing.assert_array_equal(load_text(tmp_path, text).vertices, load_lens("dgauss-50mm").vertices)


@pytest.mark.parametrize("name", FROM_PREVIOUS)
def test_published_tables_of_the_older_form(tmp_path, name):
    lens, reference = load_text(tmp_path, FROM_PREVIOUS[name]), load_lens(name)
    scale = reference.surfaces[0].radius / lens.surfaces[0].radius
    assert lens.stop_index == reference.stop_index
    np.testing.assert_allclose(lens.vertices * scale, reference.vertices, rtol=2e-3, atol=1e-3)
    assert lens.first_order().focal_length_mm * scale == pytest.approx(
        reference.first_order().focal_length_mm, rel=2e-3
    )


def test_last_row_may_hold_the_distance_to_the_film(tmp_path):
    lens = load_text(tmp_path, TO_NEXT.replace("-39.73\t0", "-39.73\t36.1"))
    np.testing.assert_array_equal(lens.vertices, load_lens("dgauss-50mm").vertices)


@pytest.mark.parametrize(
    "text",
    [
        TO_NEXT.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + TO_NEXT.encode(),
        TO_NEXT.replace("\t", "   ").encode(),
        TO_NEXT.replace("3.76", "3.76 ").replace("1.67\t25.2", "1.67\t25.2  # crown").encode(),
        TO_NEXT.encode("utf-16"),
        TO_NEXT.replace("Tronnier", "M\xfcller").encode("latin-1"),
    ],
)
def test_line_ends_marks_and_comments_do_not_matter(tmp_path, text):
    assert load_text(tmp_path, text).first_order() == load_lens("dgauss-50mm").first_order()


def test_a_flat_glass_surface_is_not_a_stop(tmp_path):
    lens = load_text(tmp_path, "0 3.6 1.5168 25\n-51.5 10 1 25\n0 5 1 12\n0 2 1.5 30\n0 0 1 30\n")
    assert lens.stop_index == 2
    assert [surface.curvature == 0 for surface in lens.surfaces] == [True, False, True, True, True]


EYE = [(7.8, 0.55, 1.3771, 10), (6.5, 3.05, 1.3374, 10), (0, 0.1, 0, 6), (10.2, 4, 1.42, 10), (-6, 0, 1.336, 10)]


def test_a_stop_of_index_0_lies_in_the_medium_before_it(tmp_path):
    table = "\n".join(" ".join(map(str, row)) for row in EYE)
    keys = ("radius", "thickness", "ior", "semi_aperture")
    rows = [dict(zip(keys, (*row[:3], row[3] / 2), strict=True)) for row in EYE]
    matrix = np.eye(2)
    for (radius, gap, after, _), before in zip(EYE, (1, 1.3771, 1.3374, 1.3374, 1.42), strict=True):
        index = after or before
        power = (index - before) / radius if radius else 0.0
        matrix = np.array([[1, gap / index], [0, 1]]) @ np.array([[1, 0], [-power, 1]]) @ matrix
    expected = -1.336 / matrix[1, 0]
    assert expected == pytest.approx(22.3, abs=0.1)
    for text, name in ((table, "eye.dat"), (json.dumps({"name": "eye", "surfaces": rows}), "eye.json")):
        lens = load_text(tmp_path, text, name)
        assert (lens.stop_index, float(lens.stop.glass.index(550))) == (2, 1.3374)
        assert lens.first_order().focal_length_mm == pytest.approx(expected, rel=1e-12)


def test_a_table_without_a_stop_has_none(tmp_path):
    assert load_text(tmp_path, "20 40 1.5 24\n-20 0 1 24\n").stop_index is None


BAD = [
    ("29.4 3.7 1.67\n", r"lens\.dat:1: expected 4 columns, radius, axial distance, index, diameter \(got 3\)"),
    ("29.4 3.7 1.67 25 1\n", r"lens\.dat:1: expected 4 columns.*\(got 5\)"),
    ("# nothing\n\n", r"lens\.dat: a lens needs surfaces; the table is empty"),
    ("29.4 3.7 glass 25\n", r"lens\.dat:1: expected four numbers"),
    ("29.4 nan 1.67 25\n", r"lens\.dat:1: every number must be finite"),
    ("# c\n29.4 3.7 1.67 -25\n", r"lens\.dat:2: diameter must be above 0 \(got -25\)"),
    ("29.4 3.7 0.5 25\n-30 0 1 25\n", r"lens\.dat:1: index must lie between 1 and 5"),
    ("29.4 3.7 1.6 25\n0 1 0 9\n0 2 0 8\n-30 0 1 25\n", r"lens\.dat:3: a second stop .*line 2 has the first"),
    ("29.4 0 1.6 25\n-30 3 1 25\n-50 0 1 25\n", r"lens\.dat:1: cannot tell whether"),
    (
        "9 3.7 1.6 25\n-30 0 1 25\n",
        r"lens\.dat:1: surface 0, diameter: the diameter 25 mm is more than twice the radius 9",
    ),
    ("\0\0\0\0", r"lens\.dat: contains NUL bytes"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[message[:50] for _, message in BAD])
def test_a_bad_table_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        load_text(tmp_path, text)
    assert "\n" not in str(caught.value)
