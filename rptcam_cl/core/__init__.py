"""What every other part stands on: errors, files of the package, YAML, and the records that kernels share."""
