"""The viewfinder: a scene rendered while pages in browsers and notebooks look at it and turn the camera's dials."""

from rptcam_cl.viewfinder.doors import is_loopback
from rptcam_cl.viewfinder.finder import TooManyClientsError, Viewfinder
from rptcam_cl.viewfinder.notebook import widget
from rptcam_cl.viewfinder.serving import ViewServer, check_server, serve

__all__ = ["TooManyClientsError", "ViewServer", "Viewfinder", "check_server", "is_loopback", "serve", "widget"]
