"""Records have the same size and members the same offsets on host and device."""

from collections import defaultdict
from collections.abc import Iterator
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


def layout(record: Record) -> Iterator[str]:
    """Statements that write the size of a record and the offset of each member; OpenCL C 1.2 has no offsetof."""
    yield f"{{ {record.name} r; *out++ = (uint)sizeof(r);"
    for _, name in record.members:
        yield f"*out++ = (uint)((char *)&r.{base(name)} - (char *)&r);"
    yield "}"


def test_device_lays_out_records_as_the_host(session, tmp_path: Path):
    source = tmp_path / "probe_layout.cl"
    body = "\n".join(line for record in RECORDS for line in layout(record))
    source.write_text(f"__kernel void probe_layout(__global uint *out)\n{{\n{body}\n}}\n")
    program = session.program([str(source)], {"VW": 1}, device_declarations())
    count = sum(1 + len(record.members) for record in RECORDS)
    out = session.allocate(4 * count)
    session.bind(program, "probe_layout", out=out).enqueue(1, 1)
    numbers = iter(map(int, session.read(out, np.uint32, count)))
    for record in RECORDS:
        size, offsets = next(numbers), {base(name): next(numbers) for _, name in record.members}
        assert size == record.dtype.itemsize, record.name
        assert offsets == {name: field[1] for name, field in record.dtype.fields.items()}, record.name


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
    [((), "QUEUE"), (("HAS_EMITTERS",), "CZ"), (("HAS_CURVE",), "TARGET_TRIANGLE"), (("HAS_EMITTERS", "MOVES"), "TIME"),
     (("SPECTRUM", "HAS_MESH"), "WAVELENGTH_SAMPLE"), (("LIGHT_TREE",), "NZ"),
     (("LIGHT_TREE", "LIGHT_LOBES"), "LOBE_SHARE"), (("CAUSTICS",), "SINCE_RECEIVER"),
     (("LIGHT_PASSES",), "MIS"), (("LAMPS_BEHIND_GLASS",), "CHANCE")],
)  # fmt: skip
def test_slot_of_a_path_ends_with_the_last_field_that_a_scene_needs(needed: tuple[str, ...], last: str) -> None:
    floats = floats_per_slot(defaultdict(int, dict.fromkeys(needed, 1)), stream=False)
    assert STATE_FIELDS[:floats][-1] == last


def test_kernels_tell_solid_emitters_by_their_numbers() -> None:
    assert {kind for kind in EmitterKind if kind >= EmitterKind.BOX} == SOLID_EMITTERS
    assert {EmitterKind.POINT, EmitterKind.SPOT, EmitterKind.PROFILE} <= SIZELESS_EMITTERS
