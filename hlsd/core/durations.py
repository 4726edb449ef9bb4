"""Durations for people."""


def about(seconds: float) -> str:
    """A duration for people, no finer than a forecast deserves."""
    if seconds < 55.0:
        return f"about {max(5, 5 * round(seconds / 5)):d} s"
    minutes = max(1, round(seconds / 60.0))
    hours, rest = divmod(minutes, 60)
    return f"about {hours} h {rest} min" if hours else f"about {minutes} min"
