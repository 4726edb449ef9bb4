"""Speed modulation: how much faster or slower than the data may the robot drive here?

LfH and HLSD learned from mostly constant 0.4 m/s drive "up to 0.6 m/s max speed,
modulated from mostly 0.4 m/s" (section IV-B of the paper). The rule by which they do is
unpublished; this one is ours:

    s = share of N noisy copies of the command that pass the collision check
    v, omega -> (0.5 + s) v, (0.5 + s) omega, with v up to 0.6 m/s

so 1.5 times as fast where all pass, half as fast where none does, and the same arc in
every case. The noise stands for how little a robot does exactly what it is told. The
published code of the same group keeps what may be a remainder of the module: its
collision check takes a number of samples and a relative noise of v and omega, and
returns the share of safe ones (LearningUAV/hallucination, LfD_2D/run_policy.py).

The rule was fixed before any run and is not tuned to a driving time. The planners of
the 1.0 m/s data have no such module (section IV-A).
"""

from dataclasses import dataclass

import numpy as np

from hlsd.core.types import FloatArray
from hlsd.planners.base import Setup
from hlsd.planners.bounds import require_within
from hlsd.planners.learned.safety import SafetyLayer, SafetySpec

# Least and most; what loops grow with.
_LIMITS = {
    "rollouts": (1, 10_000),
    "steps": (1, 1000),
    "horizon_s": (0.001, 60.0),
    "relative_sd": (0.0, 10.0),
    "max_speed": (0.001, 100.0),
}


@dataclass(frozen=True, slots=True)
class ModulationSpec:
    """Numbers of the rule.

    Attributes:
        rollouts: N, noisy copies of the command.
        relative_sd: Standard deviation of the Gaussian factor 1 + noise on v and, drawn
            anew, on omega.
        horizon_s: How far ahead each copy is driven: longer than the collision check's
            0.2 s, so that the robot slows down before it is stopped.
        steps: Poses tested over the horizon, 1.2 cm apart at 0.6 m/s.
        least: Factor where no copy is safe.
        most: Factor where all are.
        max_speed: Of the modulated command [m/s].
    """

    rollouts: int = 10
    relative_sd: float = 0.1
    horizon_s: float = 0.3
    steps: int = 15
    least: float = 0.5
    most: float = 1.5
    max_speed: float = 0.6

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            HlsdError: One is beyond its limits.
        """
        require_within(self, _LIMITS)


class SpeedModulation:
    """Scales commands by the room that the present scan leaves them."""

    def __init__(self, setup: Setup, spec: ModulationSpec) -> None:
        """Begin an episode; the same ``setup`` gives the same noise."""
        self._spec = spec
        self._check = SafetyLayer(
            setup, SafetySpec(horizon_s=spec.horizon_s, steps=spec.steps)
        )
        self._rng = np.random.Generator(np.random.PCG64(setup.seed))
        self._factors = np.empty((0, spec.rollouts, 2))
        self._tick = 0

    def modulate(
        self, ranges_m: FloatArray, speed: float, yaw_rate: float
    ) -> tuple[float, float]:
        """Speed [m/s] and yaw rate [rad/s] of the same arc, faster or slower.

        Args:
            ranges_m: The real scan, ``(beams,)`` [m].
            speed: Proposed, 0 or more [m/s].
            yaw_rate: Proposed [rad/s].
        """
        spec = self._spec
        factor = spec.least + (spec.most - spec.least) * self._safe_share(
            ranges_m, speed, yaw_rate
        )
        if factor * speed > spec.max_speed:
            factor = spec.max_speed / speed
        return factor * speed, factor * yaw_rate

    def _safe_share(self, ranges_m: FloatArray, speed: float, yaw_rate: float) -> float:
        # Always as many draws, so that the noise of a tick depends on its number alone.
        if self._tick == len(self._factors):
            spec, self._tick = self._spec, 0
            noise = self._rng.standard_normal((_TICKS, spec.rollouts, 2))
            self._factors = 1.0 + spec.relative_sd * noise
        factors = self._factors[self._tick]
        self._tick += 1
        return self._check.safe_share(ranges_m, speed, yaw_rate, factors)


# Ticks whose noise is drawn at a time.
_TICKS = 64
