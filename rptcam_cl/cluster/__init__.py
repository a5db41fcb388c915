"""Renders on a cluster of machines, or in several processes of one, by dask.distributed."""

from rptcam_cl.cluster.client import TLS, workers_here
from rptcam_cl.cluster.parts_folder import PartsFolder
from rptcam_cl.cluster.run import render_on_cluster
from rptcam_cl.cluster.series import render_scenes_on_cluster

__all__ = ["TLS", "PartsFolder", "render_on_cluster", "render_scenes_on_cluster", "workers_here"]
