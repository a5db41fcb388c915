"""What all else stands on: errors, files, strict YAML, spectra, and the records that kernels share."""
