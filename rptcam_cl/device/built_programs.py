"""Programs as the driver built them, kept for the next run where the driver keeps none itself.

PoCL and NVIDIA's driver have caches of their own. Intel's has none, and takes seconds for a scene. What is kept carries
its own hash: drivers do not survive a damaged program.
"""

from __future__ import annotations

import hashlib
from typing import Any

from rptcam_cl.device.kept import keep_bytes, kept_bytes
from rptcam_cl.device.opencl import load_opencl

_HASH_BYTES = 32


def build_program(context: Any, device: Any, source: str, options: list[str]) -> Any:
    """Return the program built of ``source`` for a pyopencl device; raises what pyopencl raises."""
    cl = load_opencl()
    from pyopencl.characterize import has_src_build_cache

    if has_src_build_cache(device):
        return cl.Program(context, source).build(options=options, devices=[device])
    name = _name(device, source, options)
    kept = kept_bytes("programs", name) or b""
    if kept and hashlib.sha256(kept[_HASH_BYTES:]).digest() == kept[:_HASH_BYTES]:
        try:
            return cl.Program(context, [device], [kept[_HASH_BYTES:]]).build(options=options, devices=[device])
        except cl.Error:  # of a driver that has changed and does not tell
            pass
    program = cl.Program(context, source).build(options=options, devices=[device])
    binary = bytes(program.get_info(cl.program_info.BINARIES)[0])
    keep_bytes("programs", name, hashlib.sha256(binary).digest() + binary)
    return program


def _name(device: Any, source: str, options: list[str]) -> str:
    platform = device.platform
    facts = [platform.name, platform.version, device.name, device.version, device.driver_version, *options, source]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()
