"""Several trainings at a time: the same bytes, and how all of it ends."""

import multiprocessing
import os
import signal
from dataclasses import replace

import numpy as np
import pytest

import hlsd.learning.train_many as train_many_module
from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning.train_many import Training, train_many
from hlsd.learning.training import TRAINABLE, Optimiser, train_recipe


@pytest.fixture(scope="module")
def drive_log(tmp_path_factory):
    """A circle at 0.5 m/s."""
    time_s = 0.04 * np.arange(400)
    yaw = 0.4 * time_s
    poses = np.column_stack((1.25 * np.sin(yaw), 1.25 * (1 - np.cos(yaw)), yaw))
    commands = np.tile([0.5, 0.4], (400, 1))
    path = tmp_path_factory.mktemp("log") / "drive.npz"
    MotionLog(0.04, poses, commands, "jackal", "1", "{}", 300).save(path)
    return path


def training(log, steps=40, seed=0, planner="lfh04"):
    recipe = replace(
        TRAINABLE[planner],
        hidden=(16, 16),
        optimiser=Optimiser(steps=steps, batch=64),
    )
    return Training(recipe, log, seed)


def test_an_error_in_one_training_ends_all_with_one_line(drive_log, tmp_path):
    made = {}
    with pytest.raises(HlsdError, match=r"'?nowhere\.npz.*") as failed:
        train_many(
            [training(drive_log, steps=10**7), training(tmp_path / "nowhere.npz")],
            2,
            made.__setitem__,
        )
    assert "\n" not in str(failed.value)
    assert made == {}
    assert multiprocessing.active_children() == []


def test_a_process_that_leaves_without_a_policy_is_one_line(drive_log, monkeypatch):
    monkeypatch.setattr(train_many_module, "_train", lambda _: os._exit(0))
    with pytest.raises(HlsdError, match=r"lfh04 ended without a policy \(exit code 0"):
        train_many([training(drive_log)], 1, lambda *_: None)
    assert multiprocessing.active_children() == []


def test_trainings_at_a_time_make_the_same_bytes_and_end_when_interrupted(
    drive_log, tmp_path, capfd
):
    """Two at a time of three; the last is interrupted when the others are done."""
    trainings = [training(drive_log, seed=seed) for seed in (0, 1)]
    made, finished_steps = {}, []

    def interrupt(number, done, total):
        if done == total:
            finished_steps.append((number, done))
        if number == 2 and len(made) == 2:
            for child in multiprocessing.active_children():
                os.kill(child.pid, signal.SIGINT)  # as a terminal does
            raise KeyboardInterrupt
        assert not (number == 2 and not made), "three at a time"

    with pytest.raises(KeyboardInterrupt):
        train_many(
            [*trainings, training(drive_log, steps=10**7)],
            2,
            made.__setitem__,
            interrupt,
        )
    assert multiprocessing.active_children() == []
    assert "Traceback" not in capfd.readouterr().err
    assert sorted(finished_steps) == [(0, 40), (1, 40)]
    assert sorted(made) == [0, 1]
    assert all(trained.at_once == 2 for trained in made.values())
    assert all(trained.wall_s > 0.0 for trained in made.values())
    made[1].policy.save(tmp_path / "apart.npz")
    log = MotionLog.load(drive_log)
    train_recipe(trainings[1].recipe, log, 1).save(tmp_path / "here.npz")
    apart, here = (
        (tmp_path / f"{name}.npz").read_bytes() for name in ("apart", "here")
    )
    assert apart == here
    assert made[0].policy.provenance != made[1].policy.provenance
