"""Renders on a cluster of machines, or in several processes of one, by dask.distributed."""

from rptcam_cl.cluster.client import TLS
from rptcam_cl.cluster.parts_folder import PartsFolder
from rptcam_cl.cluster.run import render_on_cluster

__all__ = ["TLS", "PartsFolder", "render_on_cluster"]
