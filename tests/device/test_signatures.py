"""Arguments of kernels are bound by name, and the names are those of the kernels."""

import itertools
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import programs
from rptcam_cl.device.programs import BUILD_OPTIONS, assemble, expand, kernel_parameters
from tests.support.cases import one_in

SOURCE = """
#define VW 8
#define LISTED 2
#define PARTS(EACH) EACH(const __global float *, first) /* a, b */ \\
    MORE(EACH)
#if !MISSING && (VW == 8 || defined(OTHER)) && LISTED >= 2u
#define MORE(EACH) EACH(uint, second)
#elif 1
#define MORE(EACH) EACH(uint, wrong)
#else
#define MORE(EACH)
#endif
#ifdef MISSING
#define LAST , int wrong
#elif VW > 8
#define LAST , int also_wrong
#else
#define LAST , int4 last
#endif
#define AS_PARAMETER(type, name) type name,
__kernel void one(PARTS(AS_PARAMETER) __global int *out,   // what, comes out
#if LISTED
                  Wave wave
#endif
                  LAST)
{
}
#undef LAST
#define LAST
__kernel void two(__global const int * restrict in LAST) {}
"""


def test_conditions_and_macros_decide_which_parameters_a_kernel_has():
    assert kernel_parameters(SOURCE) == {"one": ("first", "second", "out", "wave", "last"), "two": ("in",)}


@pytest.mark.parametrize(("spectrum", "motion", "tree", "mesh"), one_in(5, itertools.product((0, 1), repeat=4)))
def test_the_driver_reads_the_list_of_the_scene_alike(session, tmp_path, spectrum, motion, tree, mesh):
    import pyopencl as cl

    path = tmp_path / "listed.cl"
    path.write_text('#include "common/scene.h"\n__kernel void listed(SCENE_PARAMETERS uint last) {}\n')
    facts = {
        "VW": 1,
        "SPECTRUM": spectrum,
        "HAS_MOTION": motion,
        "HAS_PRIMITIVE_TREE": tree,
        "HAS_MESH": mesh,
        "WAVELENGTH_CELLS": 3,
    }
    source = assemble([str(path)], facts, device_declarations(), library_arch=None)
    options = [*BUILD_OPTIONS, "-cl-kernel-arg-info"]
    kernel = cl.Kernel(cl.Program(session.context, source).build(options=options), "listed")
    names = [kernel.get_arg_info(index, cl.kernel_arg_info.NAME) for index in range(kernel.num_args)]
    assert kernel_parameters(source)["listed"] == tuple(names)
    assert ("colours" in names, "segments" in names) == (spectrum, motion)
    assert ("primitive_nodes" in names, "mesh_low" in names) == (tree, mesh)


def overloads(declarations):
    """Each overload as (result, name, types of its parameters), with what a compiler may take it for."""
    text = declarations.replace("__attribute__((overloadable, const))", "__ovld __cnfn")
    text = text.replace("__attribute__((overloadable, pure))", "__ovld __purefn")
    text = text.replace("__attribute__((overloadable))", "__ovld").replace("unsigned int", "uint")
    for result, kind, name, given in re.findall(r"(\w+)\s+__ovld ?(__\w+)?\s*(\w+)\s*\(([^)]*)\)\s*;", text):
        types = [re.sub(r"\b__private\b", "", each).replace("*", " * ") for each in given.split(",")]
        # a name, if any, comes last; a pointer without a space is to private memory
        yield (
            result,
            kind,
            name,
            tuple(" ".join(sorted(re.sub(r"(?<=[\w*] )[a-z]\w*$", "", each.strip()).split())) for each in types),
        )


def test_builtins_are_declared_as_the_driver_does(session):
    folder = Path(pytest.importorskip("pocl_binary_distribution").__file__).parent / ".libs/share/pocl/include"
    text = "#define DECLARES_BUILTINS\n" + expand(["common/builtins.h"], {})
    macros = {}
    active = programs._active_lines(programs._COMMENT.sub(" ", text), macros)
    lines = [programs._expand_macros(line, macros) for line in active]
    ours = set(overloads("\n".join(lines).replace("##", "")))
    theirs = set(overloads((folder / "opencl-c.h").read_text(encoding="utf-8")))
    names = {name for _, _, name, _ in ours}
    assert {"sqrt", "clz", "vload8", "convert_float16"} <= names
    assert ours - theirs == set()
    narrow = re.compile(r"half|char|short|volatile u?int")  # what kernels do not compute with, and OpenCL 2
    missing = [each for each in theirs - ours if each[2] in names]
    assert [each for each in missing if not narrow.search(" ".join((each[0], *each[3])))] == []
    # of a narrow integer only these depend on its width
    assert {each for each in ours if each[2] == "clz"} >= {(t, "__cnfn", "clz", (t,)) for t in ("uchar", "ushort")}


@pytest.fixture
def doubling(session, tmp_path):
    source = tmp_path / "doubling.cl"
    source.write_text(
        "__kernel void doubling(__global float *out, float factor, int unused) { out[0] = 2 * factor; }\n"
    )
    return session.program([str(source)], {}, "")


def test_arguments_find_their_places_by_name(session, doubling):
    out = session.allocate(4)
    launch = session.bind(doubling, "doubling", unused=np.int32(5), factor=np.float32(1.5), out=out)
    launch.enqueue(1, 1)
    assert session.read(out, np.float32, 1)[0] == 3.0
    launch.set(factor=np.float32(4.0))
    launch.enqueue(1, 1)
    assert session.read(out, np.float32, 1)[0] == 8.0


def test_missing_argument_is_named(session, doubling):
    with pytest.raises(TypeError, match="kernel doubling: no argument for factor, unused"):
        session.bind(doubling, "doubling", out=session.allocate(4))


def test_unknown_argument_is_named(session, doubling):
    given = {"out": session.allocate(4), "factor": np.float32(1), "unused": np.int32(1)}
    with pytest.raises(TypeError, match=r"doubling has no parameter count \(it has out, factor, unused\)"):
        session.bind(doubling, "doubling", **given, count=np.int32(1))
    launch = session.bind(doubling, "doubling", **given)
    with pytest.raises(TypeError, match="doubling has no parameter wave"):
        launch.set(wave=b"")


def test_launch_keeps_its_buffers(session, doubling):
    first = session.allocate(4)
    alone = sys.getrefcount(first)
    launch = session.bind(doubling, "doubling", out=first, factor=np.float32(1), unused=np.int32(1))
    assert sys.getrefcount(first) == alone + 1
    launch.set(out=session.allocate(4))
    assert sys.getrefcount(first) == alone


def test_kernels_are_used_again_once_their_launch_has_gone(session, doubling):
    given = {"unused": np.int32(5), "factor": np.float32(1.5), "out": session.allocate(4)}
    first = session.bind(doubling, "doubling", **given)
    second = session.bind(doubling, "doubling", **given)
    kernel = second._kernel
    assert kernel is not first._kernel
    del second
    assert session.bind(doubling, "doubling", **given)._kernel is kernel
