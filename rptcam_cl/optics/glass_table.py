"""Glasses that the bundled lenses name: Sellmeier coefficients of their makers' catalogues.

Source: SCHOTT optical glass catalogue as collected by refractiveindex.info (formula 2; c in square micrometres).
"""

from rptcam_cl.optics.glass import Sellmeier


def _schott(name: str, b: tuple[float, ...], c: tuple[float, ...], longest_nm: float) -> Sellmeier:
    return Sellmeier(b, c, range_nm=(300.0 if name.startswith("N-BK") else 320.0, longest_nm), name=name)


_TABLE = (
    _schott("N-BK7", (1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), 2500.0),
    _schott("N-SK16", (1.34317774, 0.241144399, 0.994317969), (0.00704687339, 0.0229005, 92.7508526), 2500.0),
    _schott("F2", (1.34533359, 0.209073176, 0.937357162), (0.00997743871, 0.0470450767, 111.886764), 2500.0),
    _schott("SF5", (1.46141885, 0.247713019, 0.949995832), (0.0111826126, 0.0508594669, 112.041888), 2500.0),
    _schott("SF4", (1.61957826, 0.339493189, 1.02566931), (0.0125502104, 0.0544559822, 117.652222), 2500.0),
    _schott("LF5", (1.28035628, 0.163505973, 0.893930112), (0.00929854416, 0.0449135769, 110.493685), 2500.0),
    _schott("N-LAK12", (1.17365704, 0.588992398, 0.978014394), (0.00577031797, 0.0200401678, 95.4873482), 2500.0),
    _schott("N-BAK1", (1.12365662, 0.309276848, 0.881511957), (0.00644742752, 0.0222284402, 107.297751), 2500.0),
    _schott("N-BALF4", (1.31004128, 0.142038259, 0.964929351), (0.0079659645, 0.0330672072, 109.19732), 2500.0),
)

GLASSES = {glass.name: glass for glass in _TABLE}
