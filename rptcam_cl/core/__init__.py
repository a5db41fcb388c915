"""What all else stands on: errors, files, strict YAML, spectra, and the records that kernels share.

Here are the version, numbers of physics and limits of the program, none an array: each is written nowhere else.
"""

__version__ = "0.2.0"

LUMENS_PER_WATT = 683.0  # SI: the luminous efficacy of light of 540 THz
LINE_F_NM, LINE_D_NM, LINE_C_NM = 486.1327, 587.5618, 656.2725  # Fraunhofer lines of n_d and V_d
PLANCK, LIGHT_SPEED, BOLTZMANN = 6.62607015e-34, 299792458.0, 1.380649e-23  # [J s], [m/s], [J/K], exact in the SI
MAX_SPP, MAX_SEED = 2**32 - 1, 2**64 - 1  # the numbers of samples have 32 bits on the device, seeds 64
GOLDEN = (5**0.5 - 1) / 2  # its multiples, less their whole parts, are spread evenly, however many there are
