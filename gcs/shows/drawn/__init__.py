"""Drawn shows: where each vehicle is to be, its light and its yaw, at every time of the show; pure."""

from gcs.shows.drawn.light_programs import LightPrograms as LightPrograms
from gcs.shows.drawn.show import Claims as Claims
from gcs.shows.drawn.show import DrawnCue as DrawnCue
from gcs.shows.drawn.show import DrawnShow as DrawnShow
from gcs.shows.drawn.show import FencePolygon as FencePolygon
from gcs.shows.drawn.trajectories import Motion as Motion
from gcs.shows.drawn.trajectories import Trajectories as Trajectories
from gcs.shows.drawn.trajectories import Trajectory as Trajectory
from gcs.shows.drawn.yaw_programs import YawPrograms as YawPrograms
