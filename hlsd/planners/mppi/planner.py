"""MPPI as the public BARN configuration runs it: Nav2's controller in Nav2's loop.

At each tick 2000 sequences of 56 controls are drawn around the last solution and driven
in imagination (`hlsd.planners.mppi.batch`); eight critics charge them
(`hlsd.planners.mppi.critics`); the mean, weighted by the exponential of the costs, is
the next solution (`hlsd.planners.mppi.control`). What surrounds the controller, its
patience and recoveries, is Nav2's (`hlsd.planners.nav2`).

Parameters: ``jackal_helper/config/nav2.yaml`` of the BARN Challenge's port to ROS 2,
as Saadmaghani/The-Barn-Challenge-Ros2 has it (read in its copies
rasp-ard/barn-challenge @972d3ef and maity-barnita/The-Barn-Challenge-ROS2 @96a11e7,
whose controller sections are equal). It is Clearpath's example for the Jackal, with
accelerations of 10 m/s^2 and 20 rad/s^2. The port is made for ROS 2 Jazzy: the version
of the controller is 1.3.12.

Known limits:

- It drives at most 0.5 m/s, as that file says. The score of the BARN Challenge wants
  up to 2 m/s; ``max_speed`` lifts the limit, and the other parameters are not made for
  it.
- Nothing was tuned here.
- The file's robot has fenders, 0.508 x 0.432 m; the Jackal here is padded to about
  that (``padding_m``).
- The local costmap takes in each scan, where Nav2 updates it five times a second. It
  has one layer, where the file has voxels, and sees what the project's lidar sees.
- The global path is the project's NavFn on a costmap of the file's resolution and
  inflation; Nav2's own lies half a cell beside it.
- Noise comes from the planner's seed, and is drawn anew at each tick
  (``regenerate_noises``), from 65536 quantiles of the normal distribution. So the same
  seed gives the same bytes, which are other numbers than Nav2's.
- The footprint's outline is looked up, to within 1.4 cm (`outlines`).
- A goal that is sent again changes nothing.

Source: ros-navigation/navigation2, nav2_mppi_controller (MIT by its package.xml, files
under Apache-2.0). The formulas are its own; the code is not.
"""

from hlsd.planners.mppi.config import MppiConfig
from hlsd.planners.mppi.controller import MppiController
from hlsd.planners.nav2 import Nav2Planner


class MppiPlanner(Nav2Planner):
    """Drives the mean of sampled controls, inside Nav2."""

    def __init__(self, config: MppiConfig | None = None) -> None:
        """Drive with ``config``; None takes the public BARN parameters."""
        super().__init__(MppiController(config if config is not None else MppiConfig()))
