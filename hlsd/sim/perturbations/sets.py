"""Sets of perturbations under one name."""

from collections.abc import Mapping
from types import MappingProxyType

from hlsd.sim.perturbations.named import Disturbance

# The sizes of a Jackal that was unpacked today: nothing is calibrated, nothing tuned,
# and its computer is busy. Order: as the built-in ones. docs/perturbations.md says the
# same for people; a test compares the two.
_COLD = (
    # A bracket that stands 1 mm askew over the sensor's width of 50 mm.
    Disturbance("lidar.mount_yaw", 0.02),
    # Measured with a ruler.
    Disturbance("lidar.mount_x", 0.01),
    # Hokuyo UST-10LX: repeated accuracy below 30 mm, one standard deviation.
    Disturbance("lidar.noise_sd", 0.02),
    # Half of the same sensor's accuracy, +-40 mm.
    Disturbance("lidar.bias", 0.02),
    # The range that its maker guarantees; 30 m is what it can reach at best.
    Disturbance("lidar.max_range", 10.0),
    # Every other beam, as drivers thin scans out for slow links.
    Disturbance("lidar.beams", 360.0),
    # Assumed: dark, wet and glossy surfaces, and edges.
    Disturbance("lidar.dropout", 0.03),
    # A turn of the mirror, 25 ms, and as much again for transfer and driver.
    Disturbance("lidar.latency", 0.05),
    # Assumed: 10 m straight on leave 2 cm and 7 degrees, one standard deviation.
    Disturbance("odometry.drift", 0.01),
    # Assumed: tyres of one side larger by 0.4 % turn it by 0.6 degrees a metre.
    Disturbance("odometry.yaw_bias", 0.01),
    # Half of move_base's 20 Hz, of which it warns on busy computers.
    Disturbance("control.rate", 10.0),
    # Assumed: two ticks for the way from computer to motor controller.
    Disturbance("command.latency", 0.1),
    # Assumed: gears and tyres of a skid-steering robot stick.
    Disturbance("command.dead_band", 0.03),
    # Assumed: a dusty or damp floor.
    Disturbance("wheel.friction", 0.8),
    # Assumed: 1 cm of the Jackal's 37.6 cm, as tyres touch the ground off their middle.
    Disturbance("wheel.track", 1.03),
    # A computer and a battery; the Jackal carries 20 kg (Clearpath's data sheet).
    Disturbance("robot.payload", 5.0),
    # Put down by hand and by eye: 10 cm and 6 degrees.
    Disturbance("start.position", 0.1),
    Disturbance("start.yaw", 0.1),
)

PERTURBATION_SETS: Mapping[str, tuple[Disturbance, ...]] = MappingProxyType(
    {"cold": _COLD}
)
"""Perturbations that are named together, by the set's name, in the order in which they
act."""
