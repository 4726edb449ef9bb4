"""The example that trains by PPO: weights come out, and a planner drives with them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hlsd
from hlsd.run.protocol import HLSD2021

pytest.importorskip("gymnasium", reason="needs the extra gym")
pytest.importorskip("torch", reason="needs the extra train")

from examples import train_ppo

EXAMPLES = Path(__file__).parents[2] / "examples"


def train(monkeypatch, out):
    sizes = {
        "--steps": 256,
        "--worlds": 2,
        "--envs": 8,
        "--horizon": 16,
        "--threads": 1,
    }
    words = [f"{word}" for pair in sizes.items() for word in pair]
    monkeypatch.setattr(sys, "argv", ["train_ppo.py", "--out", str(out), *words])
    train_ppo.main()
    with np.load(out) as held:
        return {name: held[name] for name in held}


def test_weights_come_out_and_a_planner_drives_with_them(monkeypatch, tmp_path, capsys):
    weights = train(monkeypatch, tmp_path / "a.npz")
    assert "reach the goal" in capsys.readouterr().out
    assert [weights[f"w{i}"].shape for i in range(3)] == [(64, 65), (64, 64), (2, 64)]
    assert weights.pop("observation") == "flat60+local_goal"
    assert all(np.isfinite(each).all() for each in weights.values())
    again = train(monkeypatch, tmp_path / "b.npz")
    assert all(np.array_equal(weights[name], again[name]) for name in weights)

    weights_file = tmp_path / "a.npz"
    run = hlsd.bench(
        f"{EXAMPLES / 'ppo_planner.py'}:Ppo(weights={weights_file})",
        worlds=0,
        trials=1,
        protocol=replace(HLSD2021, name="short", limit_s=2.0),
        jobs=1,
        out=tmp_path / "run",
        progress=False,
    )
    (row,) = run.episodes.to_dict("records")
    assert row["reason"] in ("", "timeout") or "time" in row["reason"]
    assert row["path_length_m"] > 0.3
