"""Division, square roots and small numbers as GPUs compute them, simulated: texts of programs are changed.

OpenCL lets a division be 2.5 units in the last place off and a square root 3; NVIDIA's compiler takes `div.full` and
`sqrt.approx`, Intel's `math.inv`. Here a divisor, and the result of a square root, goes to one of its neighbours by a
hash of its bits, so that a quotient is up to 1.5 units off, a root as much, and no two operands err alike.
"""

import re

from rptcam_cl.device.programs import expand

FLUSHED = "-cl-denorms-are-zero"
_HEAD = "#define OVERLOADED static __attribute__((overloadable, always_inline))\n" + "".join(
    f"OVERLOADED {kind}{width} off({kind}{width} x) {{ return x; }}\n"
    for kind in ("int", "uint", "long", "ulong", "double")
    for width in ("", *((2, 3, 4, 8, 16) if kind != "double" else (8,)))
)
_FLOATS = """
OVERLOADED float{n} off(float{n} x)
{{
    uint{n} bits = as_uint{n}(x);
    int{n} step = as_int{n}((bits * 2654435761u) >> 30) - 1;            // -1, 0, 1 or 2
    step = step > 1 ? -1 : step;
    int{n} usual = (fabs(x) > 1e-30f) & (fabs(x) < 1e30f);
    return usual ? as_float{n}(bits + as_uint{n}(step)) : x;
}}
"""
_ROOTS = "#define near_sqrt(x) off(sqrt(x))\n#define near_rsqrt(x) off(rsqrt(x))\n"
_DECLARATIONS = "common/builtins.h"  # of the built-in functions, before all else in a program
_QUIET = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_NAME = re.compile(r"\w+")


def approximate(source: str) -> str:
    """Return the text of a program in which no division by a variable and no square root is exact."""
    scalar = _FLOATS.format(n="").replace(
        "(fabs(x) > 1e-30f) & (fabs(x) < 1e30f)", "fabs(x) > 1e-30f && fabs(x) < 1e30f"
    )
    wide = "".join(_FLOATS.format(n=n) for n in (2, 3, 4, 8, 16))
    declared = expand([_DECLARATIONS], {})
    program = source.removeprefix(declared)
    text = re.sub(r"\b(r?sqrt)\(", r"near_\1(", _QUIET.sub(" ", program))
    lines = text.split("\n")
    kept = [line if re.match(r"\s*#\s*(line|if|elif)", line) else _divisors_off(line) for line in lines]
    return source[: len(source) - len(program)] + _HEAD + scalar + wide + _ROOTS + "\n".join(kept)


def _divisors_off(line: str) -> str:
    out, place = "", 0
    while (slash := line.find("/", place)) >= 0:
        begin = slash + (2 if line[slash + 1 : slash + 2] == "=" else 1)
        begin += len(line[begin:]) - len(line[begin:].lstrip())
        end = _operand_end(line, begin)
        operand = line[begin:end]
        if not operand or operand[0].isdigit() or re.fullmatch(r"[A-Z_0-9]+", operand):  # compilers multiply by 1 / 2
            out, place = out + line[place:end], end
            continue
        out, place = f"{out}{line[place:begin]}off({_divisors_off(operand)})", end
    return out + line[place:]


def _operand_end(line: str, begin: int) -> int:
    """Return where the operand of a division ends: a name or brackets with what is called, indexed or chosen of it."""
    place = begin
    if place < len(line) and line[place] == "-":
        place += 1
    name = _NAME.match(line, place)
    place = name.end() if name else place
    while place < len(line):
        if line[place] in "([":
            place = _closing(line, place) + 1
        elif line.startswith("->", place) or (line[place] == "." and _NAME.match(line, place + 1)):
            found = _NAME.match(line, place + (2 if line[place] == "-" else 1))
            assert found is not None, line
            place = found.end()
        else:
            break
    return place


def _closing(line: str, place: int) -> int:
    depth = 0
    for at in range(place, len(line)):
        depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(line[at], 0)
        if depth == 0:
            return at
    raise AssertionError(f"brackets do not close in one line: {line}")
