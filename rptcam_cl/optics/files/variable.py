"""The keys `configurations`, `focusing` and `floating` of a lens file: zoom positions and groups that move to focus."""

from __future__ import annotations

from rptcam_cl.core.strict_yaml import Document
from rptcam_cl.optics.files.fields import Fields, as_number, problem
from rptcam_cl.optics.files.keys import CONFIGURATION, FLOATING, FOCUSING
from rptcam_cl.optics.prescription import Configuration, FocusingGroup, FocusState


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
    gaps = _gaps(document, fields, count, scale)
    stop = fields.positive("stop_diameter") * scale if "stop_diameter" in fields else None
    return Configuration(fields.text("name") or str(index), gaps, stop)


def read_floating(document: Document, top: Fields, count: int, scale: float) -> tuple[FocusState, ...]:
    """Return the states of floating groups: a list of {distance, gaps: {surface: thickness}}."""
    rows = top.get("floating") or []
    if not isinstance(rows, list):
        raise top.fail("floating", "expected a list such as [{distance: 450, gaps: {4: 1.9}}]")
    if rows and ("focusing" in top or "configurations" in top):
        raise top.fail("floating", "a lens with floating groups has neither focusing nor configurations")
    states = []
    for index in range(len(rows)):
        fields = Fields(document, ("floating", index), FLOATING)
        states.append(FocusState(fields.positive("distance") * scale, _gaps(document, fields, count, scale)))
    if any({k for k, _ in row.gaps} != {k for k, _ in states[0].gaps} for row in states):
        raise top.fail("floating", "every state must give the same gaps")
    if len({row.distance_mm for row in states}) < len(states):
        raise top.fail("floating", "two states have the same distance")
    return tuple(states)


def _gaps(document: Document, fields: Fields, count: int, scale: float) -> tuple[tuple[int, float], ...]:
    """Return the thickness behind each surface that `gaps` names [mm]."""
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
    return tuple(sorted(values))


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
