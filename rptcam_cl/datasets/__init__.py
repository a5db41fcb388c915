"""Datasets: many pictures of one scene whose keys are drawn from distributions, each with its exact camera."""

from rptcam_cl.datasets.draws import KINDS
from rptcam_cl.datasets.frames import DatasetFrame, dataset
from rptcam_cl.datasets.specification import DatasetSpecification, read_specification

__all__ = ["KINDS", "DatasetFrame", "DatasetSpecification", "dataset", "read_specification"]
