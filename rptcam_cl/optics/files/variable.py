"""The keys `configurations`, `focusing` and `floating` of a lens file: zoom positions and groups that move to focus."""

from __future__ import annotations

from rptcam_cl.optics.files.fields import Fields, as_number, problem
from rptcam_cl.optics.files.keys import CONFIGURATION, FLOATING, FOCUSING
from rptcam_cl.optics.prescription import Configuration, FocusingGroup, FocusState


def read_configurations(top: Fields, count: int, scale: float) -> tuple[Configuration, ...]:
    """Return the zoom positions: a list of {name, gaps: {surface: thickness}}."""
    result = []
    for index, fields in enumerate(top.rows("configurations", CONFIGURATION, "[{name: wide, gaps: {4: 1.9}}]")):
        gaps = _gaps(fields, count, scale)
        stop = fields.positive("stop_diameter") * scale if "stop_diameter" in fields else None
        near = _states(fields, count, scale)
        if near and "focusing" in top:
            raise fields.fail("floating", "a lens with floating groups has no focusing group")
        result.append(Configuration(fields.text("name") or str(index), gaps, stop, near))
    if len({row.name for row in result}) < len(result):
        raise top.fail("configurations", "two configurations have the same name")
    if any({k for k, _ in row.gaps} != {k for k, _ in result[0].gaps} for row in result):
        raise top.fail("configurations", "every configuration must give the same gaps")
    return tuple(result)


def read_floating(top: Fields, count: int, scale: float) -> tuple[FocusState, ...]:
    """Return the states of floating groups: a list of {distance, gaps: {surface: thickness}}."""
    if "floating" in top and ("focusing" in top or "configurations" in top):
        raise top.fail(
            "floating",
            "a lens with floating groups has neither focusing nor configurations; each of these has its own floating",
        )
    return _states(top, count, scale)


def _states(fields: Fields, count: int, scale: float) -> tuple[FocusState, ...]:
    rows = fields.rows("floating", FLOATING, "[{distance: 450, gaps: {4: 1.9}}]")
    states = [
        FocusState(
            row.positive("distance") * scale,
            _gaps(row, count, scale),
            row.number("film_shift") * scale if "film_shift" in row else None,
        )
        for row in rows
    ]
    if any({k for k, _ in row.gaps} != {k for k, _ in states[0].gaps} for row in states):
        raise fields.fail("floating", "every state must give the same gaps")
    if len({row.film_shift_mm is None for row in states}) > 1:
        raise fields.fail("floating", "every state must give film_shift, or none")
    if len({row.distance_mm for row in states}) < len(states):
        raise fields.fail("floating", "two states have the same distance")
    return tuple(states)


def _gaps(fields: Fields, count: int, scale: float) -> tuple[tuple[int, float], ...]:
    """Return the thickness behind each surface that `gaps` names [mm]."""
    gaps = fields.get("gaps")
    if not isinstance(gaps, dict) or not gaps:
        raise fields.fail(
            "gaps" if "gaps" in fields else None, "needs gaps, such as {4: 1.9}: thickness behind a surface"
        )
    values = []
    for number, path in fields.paths_by_number(
        "gaps", 0, count - 2, f"a gap lies behind a surface from 0 to {count - 2}"
    ):
        gap = as_number(fields.document, path) * scale
        if gap < 0:
            raise problem(fields.document, path, "must not be negative", gaps[path[-1]])
        values.append((number, gap))
    return tuple(sorted(values))


def read_focusing(top: Fields, count: int, scale: float) -> FocusingGroup | None:
    """Return the focusing group: {surfaces: [first, last], travel: [least, greatest]}."""
    if "focusing" not in top:
        return None
    fields = top.inner("focusing", FOCUSING)
    first, last = fields.span("surfaces", count)
    travel = fields.numbers("travel")
    if first == 0 and last == count - 1:
        raise fields.fail("surfaces", "the group is the whole lens; leave focusing out")
    if len(travel) != 2 or not travel[0] < travel[1]:
        raise fields.fail("travel", "expected [least, greatest] shift towards the film")
    return FocusingGroup(first, last, (travel[0] * scale, travel[1] * scale))
