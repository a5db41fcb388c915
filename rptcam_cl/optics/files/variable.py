"""The keys `configurations` and `focusing` of a lens file: zoom positions and a group that moves to focus."""

from __future__ import annotations

from rptcam_cl.optics.files.fields import Fields, as_number, problem
from rptcam_cl.optics.files.keys import CONFIGURATION, FOCUSING
from rptcam_cl.optics.variable import Configuration, FocusingGroup
from rptcam_cl.strict_yaml import Document


def read_configurations(document: Document, top: Fields, count: int, scale: float) -> tuple[Configuration, ...]:
    """Return the zoom positions: a list of {name, gaps: {surface: thickness}}."""
    rows = top.get("configurations") or []
    if not isinstance(rows, list):
        raise top.fail("configurations", "expected a list such as [{name: wide, gaps: {4: 1.9}}]")
    result = tuple(_configuration(document, i, count, scale) for i in range(len(rows)))
    if len({row.name for row in result}) < len(result):
        raise top.fail("configurations", "two configurations have the same name")
    if any({k for k, _ in row.gaps} != {k for k, _ in result[0].gaps} for row in result):
        raise top.fail("configurations", "every configuration must give the same gaps")
    return result


def _configuration(document: Document, index: int, count: int, scale: float) -> Configuration:
    fields = Fields(document, ("configurations", index), CONFIGURATION)
    gaps = fields.get("gaps")
    if not isinstance(gaps, dict) or not gaps:
        raise fields.fail(
            "gaps" if "gaps" in fields else None, "needs gaps, such as {4: 1.9}: thickness behind a surface"
        )
    values = []
    for key in gaps:
        path = (*fields.path, "gaps", key)
        number = int(key) if isinstance(key, int) or (isinstance(key, str) and key.isdigit()) else -1
        if isinstance(key, bool) or not 0 <= number < count - 1:
            raise problem(document, path, f"a gap lies behind a surface from 0 to {count - 2}", key)
        gap = as_number(document, path) * scale
        if gap < 0:
            raise problem(document, path, "must not be negative", gaps[key])
        values.append((number, gap))
    stop = fields.positive("stop_diameter") * scale if "stop_diameter" in fields else None
    return Configuration(fields.text("name") or str(index), tuple(sorted(values)), stop)


def read_focusing(document: Document, top: Fields, count: int, scale: float) -> FocusingGroup | None:
    """Return the focusing group: {surfaces: [first, last], travel: [least, greatest]}."""
    if "focusing" not in top:
        return None
    fields = Fields(document, ("focusing",), FOCUSING)
    span, travel = fields.numbers("surfaces"), fields.numbers("travel")
    if len(span) != 2 or any(part % 1 for part in span) or not 0 <= span[0] <= span[1] < count:
        raise fields.fail("surfaces", f"expected [first, last], two numbers from 0 to {count - 1}")
    if span[0] == 0 and span[1] == count - 1:
        raise fields.fail("surfaces", "the group is the whole lens; leave focusing out")
    if len(travel) != 2 or not travel[0] < travel[1]:
        raise fields.fail("travel", "expected [least, greatest] shift towards the film")
    return FocusingGroup(int(span[0]), int(span[1]), (travel[0] * scale, travel[1] * scale))
