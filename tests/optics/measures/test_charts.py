"""Every chart has a title, units and labels that can be read at 800 pixels; the same chart gives the same file."""

import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from rptcam_cl.optics.charts import add_key, chart_svg, encode, new_chart, styled
from rptcam_cl.optics.drawing import draw_lens
from rptcam_cl.optics.field_measures import (
    distortion_chart,
    distortion_table,
    film_radii,
    transmittance_chart,
    transmittance_table,
    vignetting_chart,
    vignetting_table,
)
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import film_spots, mtf, point_image, psf_chart, setting, spot_chart
from rptcam_cl.studies.focus.probe import FocusReport, ProbeRecord, Zone, focus_plot
from tests.support.cases import fast, slow

TESSAR = setting(load_lens("tessar-100mm"))
WAVES = (486.1, 587.6, 656.3)
UNIT = r"\[(mm|µm|nm|%|% of all|degrees|pixels|cycles/mm)\]$"


def spots(fields: tuple[float, ...]) -> Figure:
    return spot_chart(TESSAR, film_spots(TESSAR, fields, WAVES, 16))


def autofocus(*quantities: str) -> Figure:
    probes = [
        ProbeRecord(40 + k, 40 + 0.013 * k, 1 / (1 + k), 0.1, 1 - 0.03 * (k % 3), 9, 0.1, quantity)  # type: ignore[arg-type]
        for k, quantity in enumerate(quantities)
    ]
    report = FocusReport("x", 41.0, 40.02, 1.0, 1.0, 0.01, 0.1, Zone(0.4, 0.6, 0.4, 0.6), probes=probes)
    return focus_plot(report, "scene: autofocus")


CHARTS: dict[str, Callable[[], Figure]] = {
    "spots": lambda: spots((0.0, 10.0, 20.0)),
    "spots of one field": lambda: spots((0.0,)),
    "spots of many fields": lambda: spots((0.0, 5.0, 10.0, 15.0, 20.0)),
    "mtf": lambda: mtf(TESSAR, (50.0,), (0.0, 10.0), WAVES, diffraction=False, rays=16).chart(),
    "psf": lambda: psf_chart(TESSAR, point_image(film_spots(TESSAR, (5.0,), WAVES, 16), 16), 5.0),
    "vignetting": lambda: vignetting_chart(TESSAR, vignetting_table(TESSAR, film_radii(TESSAR, 2, 20.0))),
    "distortion": lambda: distortion_chart(TESSAR, distortion_table(TESSAR, (0.0, 10.0), WAVES, "tan"), "tan"),
    "transmittance": lambda: transmittance_chart(TESSAR, transmittance_table(TESSAR, (400.0, 700.0))),
    "contrast": lambda: autofocus(*["contrast"] * 9),
    "hybrid": lambda: autofocus("displacement", "displacement", *["contrast"] * 3),
}


def labels_of(figure: Figure) -> list[tuple[str, tuple[float, float, float, float], float]]:
    """Each text that is seen at 800 pixels: words, edges and height of its letters [pixels]."""
    figure.set_dpi(100)
    canvas = FigureCanvasAgg(figure)
    with styled():
        canvas.draw()
    unseen = {text for axes in figure.axes for text in undrawn(axes)}
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text not in unseen]
    found = [(text.get_text(), text.get_window_extent(), text.get_fontsize() * 100 / 72) for text in texts]
    return [(words, box.extents, size) for words, box, size in found if words.strip()]


def undrawn(axes: Axes) -> Iterator[Text]:
    """The texts of a chart that is not drawn, and the numbers beyond the ends of axes."""
    if not axes.get_visible() or not axes.axison:
        yield from axes.findobj(Text)
    for axis, end in ((axes.xaxis, 0), (axes.yaxis, 1)):
        low, high = sorted(axis.get_view_interval())
        slack = 1e-9 * (high - low)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            for text in (tick.label1, tick.label2):
                if not low - slack <= text.get_position()[end] <= high + slack:
                    yield text


@pytest.mark.parametrize("name", fast(["spots of one field", "mtf", "vignetting", "distortion", "contrast"], CHARTS))
def test_chart_has_title_units_and_labels_that_can_be_read(name: str) -> None:
    figure = CHARTS[name]()
    assert figure.get_size_inches()[0] <= 8
    assert figure.get_suptitle().startswith(("Tessar 100 mm f/2.8: ", "scene: "))
    for axes in figure.axes:
        if axes.get_visible():
            words = [word for word in (axes.get_xlabel(), axes.get_ylabel()) if word]
            assert words and all(re.search(UNIT, word) for word in words), words
    check_labels(figure)


def check_labels(figure: Figure) -> None:
    labels = labels_of(figure)
    width, height = figure.get_size_inches() * 100
    assert len(labels) > 5
    for words, (left, low, right, high), size in labels:
        assert 0 <= left < right <= width and 0 <= low < high <= height, f"{words} leaves the chart"
        assert size >= 12, words
    for (one, a, _), (two, b, _) in itertools.combinations(labels, 2):
        apart = a[2] <= b[0] + 1 or b[2] <= a[0] + 1 or a[3] <= b[1] + 1 or b[3] <= a[1] + 1
        assert apart, f"{one!r} lies over {two!r}"


def test_labels_that_overlap_are_found() -> None:
    with styled():
        figure, axes = new_chart("title", ("x [mm]", "y [mm]"), (0.0, 1.0))
        axes.text(0.5, 0.5, "one")
        axes.text(0.51, 0.5, "two")
    with pytest.raises(AssertionError, match="'one' lies over 'two'"):
        check_labels(figure)


def test_long_title_and_many_curves_stay_on_the_chart() -> None:
    with styled():
        figure, axes = new_chart("a lens with a very long name " * 6, ("x [mm]", "y [mm]"), (0.0, 1.0))
        lines = [axes.plot([0, 1], [0, k], label=f"configuration number {k}")[0] for k in range(14)]
        add_key(figure, lines)
    check_labels(figure)


@pytest.mark.parametrize("suffix", [".svg", *map(slow, (".png", ".pdf"))])
def test_same_chart_gives_the_same_file_whatever_the_users_settings(suffix: str) -> None:
    path = Path(f"chart{suffix}")
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "black"}):
        mine = encode(CHARTS["distortion"](), path)
    assert mine == encode(CHARTS["distortion"](), path)
    assert b"20" + b"26-" not in mine  # no date


def test_svg_of_a_chart_has_its_title_and_its_letters() -> None:
    text = chart_svg(CHARTS["distortion"]())
    root = ElementTree.fromstring(text)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    title = root.find("{http://www.w3.org/2000/svg}title")
    assert title is not None and title.text == "Tessar 100 mm f/2.8: distortion against f tan(angle)"
    assert ">distortion [%]</text>" in text


def test_drawing_as_png_shows_what_its_svg_shows() -> None:
    import io

    from PIL import Image

    picture = draw_lens(setting(load_lens("ball")))
    with Image.open(io.BytesIO(encode(picture, Path("ball.png")))) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape[:2] == (round(1.5 * picture.height), 1440)
    glass = pixels[round(1.5 * picture.height / 2) + 9, :, :]  # beside the optical axis
    assert ((glass[:, 2] - glass[:, 0]) > 20).sum() > 100  # blue glass
