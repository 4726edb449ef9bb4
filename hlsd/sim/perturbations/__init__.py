"""What stands between the world and the robot: noise, latency, slip, by name and size.

A perturbation wraps the sensor, the odometry, the commands, the physics or the start. A
run's conditions name it with its size, and it draws from the (seed, world, trial) root,
so that every planner meets the same. One of your own is announced under the entry point
group ``hlsd.perturbations``.
"""

from hlsd.sim.perturbations.base import Perturbation as Perturbation
from hlsd.sim.perturbations.base import Situation as Situation
from hlsd.sim.perturbations.named import BUILT_IN as BUILT_IN
from hlsd.sim.perturbations.named import Disturbance as Disturbance
from hlsd.sim.perturbations.named import PerturbationFactory as PerturbationFactory
from hlsd.sim.perturbations.named import perturbations as perturbations
from hlsd.sim.perturbations.reading import disturbances as disturbances
from hlsd.sim.perturbations.reading import parse_disturbance as parse_disturbance
from hlsd.sim.perturbations.reading import (
    recorded_disturbances as recorded_disturbances,
)
from hlsd.sim.perturbations.sets import PERTURBATION_SETS as PERTURBATION_SETS
