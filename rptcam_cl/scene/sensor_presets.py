"""Sensors by name: keys of `Sensor` as published, nothing else.

kac-12040
    ON Semiconductor KAC-12040/D, rev. 5 (March 2016), table 1: rolling shutter, efficiencies at 620, 540 and 470 nm.
imx477
    Sony IMX477 of the Raspberry Pi High Quality Camera at its base gain, measured by J. Hogan (Pi HQ Cam Sensor
    Performance, strollswithmydog.com). The quantum efficiency is not among the figures.
kaf-3200me
    Kodak KAF-3200ME in a QSI 532 camera, measured by C. Buil (Parameters of CCD and CMOS cameras,
    astrosurf.com/buil/cameras): efficiency at 656.3 nm, dark signal at 0 degrees Celsius, 1.413 electrons per DN.
"""

from __future__ import annotations

from typing import Any

PRESETS: dict[str, dict[str, Any]] = {
    "kac-12040": {
        "pixel_pitch_um": 4.7,
        "quantum_efficiency": [0.45, 0.47, 0.40],
        "full_well_e": 16000,
        "read_noise_e": 3.7,
        "bit_depth": 10,
    },
    "imx477": {
        "pixel_pitch_um": 1.55,
        "full_well_e": 8180,
        "read_noise_e": 3.0,
        "system_gain_dn_per_e": 0.47,
        "black_level_dn": 256,
        "bit_depth": 12,
    },
    "kaf-3200me": {
        "pixel_pitch_um": 6.8,
        "bayer": "monochrome",
        "quantum_efficiency": 0.79,
        "full_well_e": 70000,
        "read_noise_e": 12.6,
        "dark_current_e_per_s": 0.080,
        "dark_current_celsius": 0,
        "system_gain_dn_per_e": 1 / 1.413,
        "bit_depth": 16,
    },
}
