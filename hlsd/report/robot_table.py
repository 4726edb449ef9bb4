"""A robot beside a recording as text: what `hlsd robots validate` prints."""

from hlsd.sim.validation import RobotValidation


def robot_text(result: RobotValidation) -> str:
    """Errors of the pose after 1 s, then steady gains; aligned, for a terminal."""
    position, heading = result.position_error_m, result.heading_error_deg
    simulated, recorded = result.gains, result.recorded
    gains = (
        ("speed gain", simulated.speed_gain, recorded.speed_gain),
        ("yaw-rate gain", simulated.yaw_gain, recorded.yaw_gain),
        (
            "lateral per yaw [m]",
            simulated.lateral_per_yaw_m,
            recorded.lateral_per_yaw_m,
        ),
    )
    return "\n".join(
        [
            f"{result.robot} {result.robot_version}, {result.n} windows of 1 s",
            "                       median      95th percentile",
            f"position error [m]     {position.median:<11.4f} {position.p95:.4f}",
            f"heading error [deg]    {heading.median:<11.3f} {heading.p95:.3f}",
            "",
            "steady driving         simulated   recorded",
            *(f"{name:<22} {_gain(a):<11} {_gain(b)}" for name, a, b in gains),
        ]
    )


def _gain(value: float | None) -> str:
    return "none steady" if value is None else f"{value:.4f}"
