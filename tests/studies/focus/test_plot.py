"""What an autofocus saw, drawn."""

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.charts import chart_svg
from rptcam_cl.studies.focus.probe import FocusReport, ProbeRecord, focus_plot
from tests.studies.focus.scenes import CENTRE


def report_of(method, quantities):
    probes = [ProbeRecord(40 + k, 40.0 + k, 1.0 / (1 + k), 0.01, 1.0, 9, 0.1, q) for k, q in enumerate(quantities)]
    return FocusReport(method, 41.0, 41.0, 1.0, 1.0, 0.01, 0.1, CENTRE, probes=probes)


@pytest.mark.parametrize(
    ("method", "quantities", "shown", "hidden"),
    [
        ("contrast", ["contrast"] * 4, "of the greatest [%]", "displacement"),
        ("phase", ["displacement"] * 2, "displacement of the halves", "of the greatest [%]"),
        ("hybrid", ["displacement"] + ["contrast"] * 3, "displacement of the halves", "nan"),
    ],
)
def test_plot_shows_what_the_method_looked_at(method, quantities, shown, hidden):
    text = chart_svg(focus_plot(report_of(method, quantities), "title"))
    assert shown in text
    assert hidden not in text
    assert "found</text>" in text
    if method == "hybrid":
        assert "of the greatest [%]" in text


def test_too_few_probes_are_no_curve():
    for method, quantity in (("depth", "distance"), ("phase", "displacement")):
        with pytest.raises(InputError, match="no curve to draw"):
            focus_plot(report_of(method, [quantity]), "title")
