"""Records have the same size and members the same offsets on host and device."""

from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.records import (
    RECORDS,
    SIZELESS_EMITTERS,
    SOLID_EMITTERS,
    STATE_FIELDS,
    EmitterKind,
    Record,
    device_declarations,
    floats_per_slot,
)
from tests.device.probes import GROUP

IN_ARRAYS = ("Primitive", "Material", "Emitter", "Environment", "Surface", "Camera", "View")


def base(member: str) -> str:
    """The name of a member without the length of an array."""
    return member.partition("[")[0]


def probe_source(record: Record) -> str:
    """A kernel that writes the size of a record and the offset of each member; OpenCL C 1.2 has no offsetof."""
    lines = [
        f"    out[{n + 1}] = (uint)((char *)&r.{base(name)} - (char *)&r);"
        for n, (_, name) in enumerate(record.members)
    ]
    body = "\n".join(lines)
    return f"""__kernel void probe_layout(__global uint *out)
{{
    {record.name} r;
    out[0] = (uint)sizeof({record.name});
{body}
}}
"""


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_device_lays_out_records_as_the_host(session, record, tmp_path: Path):
    source = tmp_path / "probe_layout.cl"
    source.write_text(probe_source(record))
    program = session.program([str(source)], {"VW": 1}, device_declarations())
    out = session.allocate(4 * (1 + len(record.members)))
    session.bind(program, "probe_layout", out=out).enqueue(1, 1)
    size, *offsets = session.read(out, np.uint32, 1 + len(record.members))
    assert size == record.dtype.itemsize
    fields = record.dtype.fields
    assert {base(name): int(offset) for (_, name), offset in zip(record.members, offsets, strict=True)} == {
        name: field[1] for name, field in fields.items()
    }


@pytest.mark.parametrize("record", [r for r in RECORDS if r.name in IN_ARRAYS], ids=lambda record: record.name)
def test_records_of_arrays_are_multiples_of_sixteen_bytes(record):
    assert record.dtype.itemsize % 16 == 0


def test_every_record_that_stands_in_arrays_is_known():
    assert set(IN_ARRAYS) <= {record.name for record in RECORDS}


def test_upload_and_read_return_what_was_there(session):
    values = np.arange(GROUP * 5, dtype=np.uint32)
    np.testing.assert_array_equal(session.read(session.upload(values), np.uint32, len(values)), values)


def test_zeroed_buffer_is_zero(session):
    buffer = session.allocate(4000, zeroed=True)
    assert not session.read(buffer, np.uint32, 1000).any()


@pytest.mark.parametrize(
    ("needed", "last"),
    [((), "T"), (("emitters",), "CZ"), (("meshes",), "TARGET_TRIANGLE"), (("emitters", "moves"), "TIME"),
     (("colours", "meshes"), "WAVELENGTH_SAMPLE"), (("light_tree",), "NZ"),
     (("light_tree", "light_lobes"), "LOBE_SHARE"), (("caustics",), "SINCE_RECEIVER")],
)  # fmt: skip
def test_slot_of_a_path_ends_with_the_last_field_that_a_scene_needs(needed: tuple[str, ...], last: str) -> None:
    names = ("emitters", "meshes", "moves", "colours", "light_tree", "light_lobes", "caustics")
    floats = floats_per_slot(stream=False, **{name: name in needed for name in names})
    assert STATE_FIELDS[:floats][-1] == last


def test_kernels_tell_solid_emitters_by_their_numbers() -> None:
    assert {kind for kind in EmitterKind if kind >= EmitterKind.BOX} == SOLID_EMITTERS
    assert {EmitterKind.POINT, EmitterKind.SPOT, EmitterKind.PROFILE} <= SIZELESS_EMITTERS
