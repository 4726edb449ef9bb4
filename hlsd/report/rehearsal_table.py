"""A rehearsal of the BARN Challenge for people: what `hlsd challenge` prints."""

import math

from hlsd.analysis.published_scores import scores_of_clip
from hlsd.analysis.rehearsal import TEST_TRIALS, TEST_WORLDS, Measured, Rehearsal
from hlsd.report.tables import (
    interval_text,
    markdown_table,
    markdown_text,
    percent_text,
    with_interval,
)


def rehearsal_markdown(held: Rehearsal) -> str:
    """The result, what is published, and the traps, as Markdown.

    Args:
        held: The rehearsal.
    """
    head = (
        f"{held.planner} by the rules of {held.protocol}: {held.runs} runs in "
        f"{held.worlds} worlds"
    )
    return "\n".join(
        [
            markdown_text(head),
            "",
            _result(held),
            _published(held),
            _traps(held),
        ]
    )


def _result(held: Rehearsal) -> str:
    rows = [
        ["predicted official score", _score_text(held.score)],
        ["success", _share_text(held.success)],
        ["collision", _share_text(held.collision)],
        ["timeout", _share_text(held.timeout)],
        ["time of successes [s]", _time_text(held.success_time_s)],
        ["time, failures at limit [s]", _time_text(held.time_s)],
    ]
    notes = [
        "In brackets: 95 % intervals from resampling worlds, of shares from counting "
        "runs by world. They hold for worlds like these; the Challenge's hidden worlds "
        "are others, and it drives in Gazebo.",
    ]
    if held.missing:
        notes.insert(
            0,
            f"This is not a whole evaluation: it has {held.missing}. The Challenge's "
            f"has {len(TEST_WORLDS)} worlds, {TEST_TRIALS} runs each.",
        )
    if held.errors:
        notes.append(
            f"{held.errors} runs ended in the planner's error and count as timeouts."
        )
    return markdown_table(["", f"score {held.clip}"], rows, *notes)


def _published(held: Rehearsal) -> str:
    rows = [
        [each.name, str(each.year), f"{score:g}", each.worlds, each.source]
        for each, score in scores_of_clip(float(held.clip.partition("-")[0]))
    ]
    return markdown_table(
        ["published, in Gazebo", "year", f"score {held.clip}", "worlds", "source"],
        rows,
        "Hidden: the Challenge's own 50 worlds. Public: the test worlds, or a part of "
        "them. None was measured here.",
    )


def _traps(held: Rehearsal) -> str:
    rows = [
        [trap.what, _score_text(trap.score), f"{trap.change:+.4f}"]
        for trap in held.traps
    ]
    return markdown_table(
        ["trap upstream", "it would print", "change"],
        rows,
        "Each line is this very run, scored as the faulty script would have.",
    )


def _score_text(held: Measured) -> str:
    return with_interval(f"{held.value:.4f}", interval_text(held.low, held.high, ".4f"))


def _share_text(held: Measured) -> str:
    text = percent_text(held.value)
    if math.isnan(held.low):
        return text
    return with_interval(
        text, interval_text(percent_text(held.low), percent_text(held.high))
    )


def _time_text(held: Measured) -> str:
    if math.isnan(held.value):
        return "none"
    return with_interval(f"{held.value:.2f}", interval_text(held.low, held.high, ".2f"))
