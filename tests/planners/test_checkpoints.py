"""Checkpoints of others: converted without running anything, and driven as published.

The published files are not here. So networks of the documented shapes are made in
torch, stored as theirs are, converted, and held against torch.
"""

import hashlib
import http.server
import io
import json
import math
import os
import pickle
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hlsd.analysis.runs import load_run
from hlsd.cli.app import app
from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.learning.checkpoints.convert import convert
from hlsd.learning.checkpoints.file import Checkpoint
from hlsd.learning.checkpoints.networks import (
    BEAMS,
    FRAME,
    LicsTransformer,
    network_of,
)
from hlsd.learning.checkpoints.residual import ResidualNetwork
from hlsd.planners import contract
from hlsd.planners.base import Observation, Setup
from hlsd.planners.checkpoints.lics import local_goal
from hlsd.planners.registry import NEED_CHECKPOINTS, make_planner
from hlsd.run.bench import Bench, resolve, run_bench

torch = pytest.importorskip("torch")
MODEL, WIDE = 32, 256


def randoms(shapes, seed=0, scale=0.1):
    generator = torch.Generator().manual_seed(seed)
    return {
        name: scale * torch.randn(shape, generator=generator)
        for name, shape in shapes.items()
    }


def actor_state(encoder="state_preprocess", last="fc", frames=4, width=24):
    sizes = [frames * FRAME, width, width, width, width]
    names = [f"{encoder}.net.0", f"{encoder}.net.2", "head.mlp.0", "head.mlp.2"]
    shapes = {}
    for name, rows, columns in zip(names, sizes[1:], sizes[:-1], strict=True):
        shapes |= {f"{name}.weight": (rows, columns), f"{name}.bias": (rows,)}
    shapes |= {f"{last}.weight": (2, width), f"{last}.bias": (2,)}
    if last == "fc_mean":
        shapes |= {"fc_log_std.weight": (2, width), "fc_log_std.bias": (2,)}
    return randoms(shapes)


def actor_by_torch(state, frames, last="fc"):
    x = torch.from_numpy(frames).reshape(-1)
    weights = [name for name in state if name.endswith("weight")]
    for name in weights[:4]:
        x = torch.relu(state[name] @ x + state[name.replace("weight", "bias")])
    return torch.tanh(state[f"{last}.weight"] @ x + state[f"{last}.bias"]).numpy()


def lics_state():
    shapes = {
        "encoder.embedding.pos_embed": (36, MODEL),
        "encoder.embedding.linear.weight": (MODEL, 20),
        "encoder.embedding.linear.bias": (MODEL,),
        "decoder.linear.weight": (MODEL, 1),
        "decoder.linear.bias": (MODEL,),
        "prediction_head.weight": (2, 2 * MODEL),
        "prediction_head.bias": (2,),
    }
    for part, attention in (("encoder", "self_attn"), ("decoder", "encoder_attn")):
        for k in range(3):
            at = f"{part}.layers.{k}"
            for name in ("k_proj", "v_proj", "q_proj", "out_proj"):
                shapes[f"{at}.{attention}.{name}.weight"] = (MODEL, MODEL)
            # The decoder's has a norm that its forward pass leaves out.
            for name in {f"{attention}_layer_norm", "self_attn_layer_norm"}:
                shapes[f"{at}.{name}.weight"] = shapes[f"{at}.{name}.bias"] = (MODEL,)
            forward = f"{at}.PositionWiseFeedForward"
            shapes[f"{forward}.w_1.weight"] = (WIDE, MODEL)
            shapes[f"{forward}.w_1.bias"] = (WIDE,)
            shapes[f"{forward}.w_2.weight"] = (MODEL, WIDE)
            shapes[f"{forward}.w_2.bias"] = (MODEL,)
            for name in ("weight", "bias"):
                shapes[f"{at}.final_layer_norm.{name}"] = (MODEL,)
    return randoms(dict(sorted(shapes.items())), scale=0.5)


def lics_by_torch(state, ranges_m, goal):
    """By PyTorch's own attention, whose scale is the model's as in the source."""
    f = torch.nn.functional

    def linear(x, name):
        return f.linear(x, state[f"{name}.weight"], state.get(f"{name}.bias"))

    def norm(x, name):
        return f.layer_norm(x, (MODEL,), state[f"{name}.weight"], state[f"{name}.bias"])

    def layer(x, other, at, attention):
        def heads(y, name):
            y = linear(y, f"{at}.{attention}.{name}")
            return y.reshape(len(y), 4, 8).transpose(0, 1)

        seen = f.scaled_dot_product_attention(
            heads(x, "q_proj"),
            heads(other, "k_proj"),
            heads(other, "v_proj"),
            scale=1 / math.sqrt(MODEL),
        )
        seen = seen.transpose(0, 1).reshape(len(x), MODEL)
        x = norm(
            x + linear(seen, f"{at}.{attention}.out_proj"),
            f"{at}.{attention}_layer_norm",
        )
        inner = torch.relu(linear(x, f"{at}.PositionWiseFeedForward.w_1"))
        return norm(
            x + linear(inner, f"{at}.PositionWiseFeedForward.w_2"),
            f"{at}.final_layer_norm",
        )

    seen = linear(
        torch.from_numpy(ranges_m).reshape(36, 20), "encoder.embedding.linear"
    )
    seen = seen + state["encoder.embedding.pos_embed"]
    for k in range(3):
        seen = layer(seen, seen, f"encoder.layers.{k}", "self_attn")
    tokens = linear(torch.from_numpy(goal).reshape(2, 1), "decoder.linear")
    for k in range(3):
        tokens = layer(tokens, seen, f"decoder.layers.{k}", "encoder_attn")
    return linear(tokens.reshape(-1), "prediction_head").numpy()


def drlvo_state():
    """The part of Stable-Baselines3's policy that acts, and some that does not."""
    f = "features_extractor"
    convolutions = {"conv1": (64, 3, 3), "downsample2.0": (256, 128, 1)}
    convolutions |= {"downsample3.0": (512, 64, 1)}
    for name, inputs, width, out in (
        ("conv2_2", 256, 128, 256),
        ("conv3_2", 512, 256, 512),
        ("layer1.0", 64, 64, 128),
        ("layer1.1", 128, 64, 128),
        ("layer2.0", 128, 128, 256),
        ("layer3.0", 256, 256, 512),
    ):
        parts = (0, 3, 6) if "_" in name else ("conv1", "conv2", "conv3")
        sizes = ((width, inputs, 1), (width, width, 3), (out, width, 1))
        for part, size in zip(parts, sizes, strict=True):
            convolutions[f"{name}.{part}"] = size
        if name[-1] == "0":
            convolutions[f"{name}.downsample.0"] = (out, inputs, 1)
    state = {}
    for seed, (name, (out, inputs, size)) in enumerate(convolutions.items()):
        at = f"{f}.{name}"
        scale = 1 / math.sqrt(inputs * size**2)
        shapes = {f"{at}.weight": (out, inputs, size, size)}
        if not name.startswith(("layer", "conv1")):
            shapes[f"{at}.bias"] = (out,)
        state |= randoms(shapes, seed, scale)
        norm = f"{f}.{norm_of(name)}"
        shapes = {f"{norm}.bias": (out,), f"{norm}.running_mean": (out,)}
        state |= randoms(shapes, seed, 0.1)
        state[f"{norm}.weight"] = 1 + 0.1 * torch.rand(out)
        state[f"{norm}.running_var"] = 0.5 + torch.rand(out)
        state[f"{norm}.num_batches_tracked"] = torch.tensor(7)
    for name, rows, columns in (
        (f"{f}.linear_fc.0", 256, 514),
        ("mlp_extractor.policy_net.0", 256, 256),
        ("mlp_extractor.value_net.0", 128, 256),
        ("action_net", 2, 256),
    ):
        shapes = {f"{name}.weight": (rows, columns), f"{name}.bias": (rows,)}
        state |= randoms(shapes, rows)
    return state | {"log_std": torch.zeros(2)}


def norm_of(name):
    """The normalisation behind a convolution."""
    head, _, last = name.rpartition(".")
    if last.startswith("conv"):
        return f"{head}.bn{last[-1]}".removeprefix(".")
    return f"{head}.{int(last) + 1}"


def drlvo_by_torch(state, scans, goal):
    f = torch.nn.functional

    def conv(x, name, stride=1):
        at, norm = f"features_extractor.{name}", f"features_extractor.{norm_of(name)}"
        weight = state[f"{at}.weight"]
        x = f.conv2d(
            x, weight, state.get(f"{at}.bias"), stride, padding=weight.shape[-1] // 2
        )
        parts = ("running_mean", "running_var", "weight", "bias")
        return f.batch_norm(x, *(state[f"{norm}.{part}"] for part in parts))

    def chain(x, names, stride=1):
        for k, name in enumerate(names):
            x = conv(torch.relu(x) if k else x, name, stride if k == 1 else 1)
        return x

    def block(x, name, stride=1):
        around = f"{name}.downsample.0"
        beside = x
        if f"features_extractor.{around}.weight" in state:
            beside = conv(x, around, stride)
        names = [f"{name}.conv{k}" for k in (1, 2, 3)]
        return torch.relu(chain(x, names, stride) + beside)

    maps = torch.zeros(1, 3, 80, 80)
    maps[0, 0] = torch.from_numpy(scans)
    x = f.max_pool2d(torch.relu(conv(maps, "conv1")), 3, 1, 1)
    beside3 = conv(x, "downsample3.0", 4)
    x = block(block(x, "layer1.0"), "layer1.1")
    beside2 = conv(x, "downsample2.0", 2)
    x = block(x, "layer2.0", 2)
    x = torch.relu(chain(x, [f"conv2_2.{k}" for k in (0, 3, 6)]) + beside2)
    x = block(x, "layer3.0", 2)
    x = torch.relu(chain(x, [f"conv3_2.{k}" for k in (0, 3, 6)]) + beside3)
    x = torch.cat((x.mean(dim=(2, 3))[0], torch.from_numpy(goal)))
    for name, after in (
        ("features_extractor.linear_fc.0", torch.relu),
        ("mlp_extractor.policy_net.0", torch.tanh),
        ("action_net", lambda y: y.clamp(-1, 1)),
    ):
        x = after(f.linear(x, state[f"{name}.weight"], state[f"{name}.bias"]))
    return x.numpy()


def by_stable_baselines(path, state):
    """An archive whose other parts would run code."""
    with zipfile.ZipFile(path, "w") as archive:
        held = io.BytesIO()
        torch.save(state, held)
        archive.writestr("data", pickle.dumps(Mean("false")))
        archive.writestr("policy.pth", held.getvalue())
        archive.writestr("pytorch_variables.pth", pickle.dumps(Mean("false")))
    return path


def dumped(path, state):
    """As the Challenge's baselines are stored: pickle.dump of a state dict."""
    path.write_bytes(pickle.dumps(state))
    return path


def saved(path, state, **options):
    torch.save(state, path, **options)
    return path


STATES = {
    "td3": actor_state(),
    "sac": actor_state("encoder", "fc_mean", frames=1),
    "lics": lics_state(),
    "drlvo": drlvo_state(),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A converted checkpoint of each kind."""
    folder = tmp_path_factory.mktemp("checkpoints")
    found = {}
    for kind, state in STATES.items():
        write = by_stable_baselines if kind == "drlvo" else dumped
        source = write(folder / f"{kind}_actor", state)
        found[kind] = folder / f"{kind}.npz"
        convert(kind, str(source)).save(found[kind])
    assert set(found) == NEED_CHECKPOINTS
    return found


@pytest.mark.parametrize("frames", [1, 4])
@pytest.mark.parametrize("encoder", ["state_preprocess", "encoder"])
def test_the_baselines_forward_pass_is_torch_s(frames, encoder, tmp_path):
    """In every form that a state dict is stored in."""
    state = actor_state(encoder, frames=frames)
    ways = (
        dumped(tmp_path / "policy_actor", state),
        saved(tmp_path / "new.pth", state),
        saved(tmp_path / "old.pth", state, _use_new_zipfile_serialization=False),
    )
    scans = np.random.default_rng(1).normal(size=(frames, FRAME)).astype(np.float32)
    expected = actor_by_torch(state, scans)
    assert np.ptp(expected) > 1e-3
    for path in ways:
        network = network_of(convert("td3", str(path)))
        assert network.frames == frames
        np.testing.assert_allclose(network(scans), expected, atol=2e-6)


def test_sac_drives_by_its_mean(files):
    scans = np.random.default_rng(1).normal(size=(1, FRAME)).astype(np.float32)
    network = network_of(Checkpoint.load(files["sac"], "sac"))
    expected = actor_by_torch(STATES["sac"], scans, "fc_mean")
    np.testing.assert_allclose(network(scans), expected, atol=2e-6)


def test_the_transformer_s_forward_pass_is_torch_s(files):
    network = network_of(Checkpoint.load(files["lics"], "lics"))
    random = np.random.default_rng(2)
    for _ in range(3):
        ranges = random.uniform(0.1, 5.0, BEAMS).astype(np.float32)
        goal = random.normal(size=2).astype(np.float32)
        expected = lics_by_torch(STATES["lics"], ranges, goal)
        assert np.abs(expected).max() > 0.1
        np.testing.assert_allclose(network(ranges, goal), expected, atol=2e-5)


def test_the_residual_network_s_forward_pass_is_torch_s(files):
    network = network_of(Checkpoint.load(files["drlvo"], "drlvo"))
    random = np.random.default_rng(3)
    scans = random.uniform(-1, 1, (80, 80)).astype(np.float32)
    goal = np.array([0.9, -0.4], np.float32)
    expected = drlvo_by_torch(STATES["drlvo"], scans, goal)
    assert 0.01 < np.abs(expected).max() < 1.0
    np.testing.assert_allclose(network(scans, goal), expected, atol=1e-4)


def test_drl_vo_pools_ten_scans_waits_and_turns(files, monkeypatch):
    shown = []

    def record(self, scans, goal):
        shown.append((scans, goal))
        return np.array([0.5, -1.0], np.float32)

    monkeypatch.setattr(ResidualNetwork, "__call__", record)
    planner = make_planner("drlvo", options=(("checkpoint", str(files["drlvo"])),))
    planner.reset(Setup())
    for tick in range(9):
        ranges = np.full(BEAMS, float(tick))
        command = planner.plan(seen(0.05 * tick, ranges_m=ranges))
        assert (command.speed, command.yaw_rate) == (0.0, 0.0)
    last = np.full(BEAMS, 30.0)
    last[9:18] = np.arange(1.0, 10.0)
    free = planner.plan(seen(0.45, ranges_m=last))
    assert (free.speed, free.yaw_rate) == (pytest.approx(1.5), pytest.approx(-0.7))
    scans, goal = shown[0]
    assert scans.shape == (80, 80)
    assert np.array_equal(scans[:20], scans[60:])
    np.testing.assert_allclose(scans[2:4], 2 * 1 / 10 - 1, rtol=1e-6)  # of 1 m
    np.testing.assert_allclose(scans[18:20, 1], [2 * 0.1 - 1, 2 * 0.5 - 1], atol=1e-6)
    np.testing.assert_allclose(scans[18:20, 2:], 1.0)
    assert goal.tolist() == [1.0, 0.0]
    for nearest, speed, yaw_rate in ((2.1, 0.375, -0.7), (0.45, 0.0, 0.7)):
        near = np.full(BEAMS, 30.0)
        near[300] = nearest
        command = planner.plan(seen(0.5, ranges_m=near))
        assert command.speed == pytest.approx(speed)
        assert command.yaw_rate == pytest.approx(yaw_rate)


def test_a_conversion_keeps_every_number_and_has_its_source(files, tmp_path):
    held = Checkpoint.load(files["td3"], "td3")
    for name, tensor in STATES["td3"].items():
        assert np.array_equal(held.tensors[name], tensor.numpy())
    source = files["td3"].with_name("td3_actor")
    assert held.said() == {
        "source": "td3_actor",
        "source_sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
    }
    convert("td3", str(source)).save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == files["td3"].read_bytes()


class Mean:
    """Runs a command when it is unpickled."""

    def __init__(self, command):
        self.command = command

    def __reduce__(self):
        return os.system, (self.command,)


@pytest.mark.parametrize("write", [dumped, saved])
@pytest.mark.parametrize("hidden", [False, True])
def test_a_file_that_would_run_code_is_refused_and_does_not(write, hidden, tmp_path):
    mean = Mean(f"touch {tmp_path / 'ran'}")
    state = {**STATES["td3"], "more": mean} if hidden else mean
    path = write(tmp_path / "mean", state)
    with pytest.raises(HlsdError, match=r"calls \w+.system when it is loaded"):
        convert("td3", str(path))
    assert not (tmp_path / "ran").exists()
    storage = torch.storage._load_from_bytes  # the way in through a storage
    nested = pickle.dumps(Mean(f"touch {tmp_path / 'ran'}"))

    class Nested:
        def __reduce__(self):
            return storage, (nested,)

    with pytest.raises(HlsdError, match=r"weights alone|when it is loaded"):
        convert("td3", str(dumped(tmp_path / "nested", {"w": Nested()})))
    assert not (tmp_path / "ran").exists()


def test_what_fits_no_network_is_refused(files, tmp_path):
    def refused(kind, state, match):
        path = saved(tmp_path / f"{len(list(tmp_path.iterdir()))}.pth", state)
        with pytest.raises(HlsdError, match=match):
            convert(kind, str(path))

    state = dict(STATES["lics"])
    refused("td3", state, "layers 'state_preprocess.net.0'")
    refused("lics", STATES["td3"], "has a tensor 'encoder.embedding.linear.weight'")
    head = "prediction_head.weight"
    refused("lics", {**state, head: torch.zeros(3, 64)}, "is 3x64, and that .* is 2x64")
    refused("lics", {**state, head: torch.full((2, 64), torch.nan)}, "not finite")
    refused("td3", actor_state(frames=4) | {"fc.bias": torch.zeros(3)}, "fc.bias")
    wide = {**STATES["td3"], "state_preprocess.net.0.weight": torch.zeros(24, 700)}
    refused("td3", wide, "takes 700 numbers, and .* a multiple of 724")
    refused("td3", {}, "no dictionary of tensors")
    refused("td3", {"epoch": 3, **STATES["td3"]}, "'epoch', which is not a tensor")
    with pytest.raises(HlsdError, match="not a pickle of a state dict"):
        convert("td3", str(tmp_path.joinpath("text")) if _text(tmp_path) else "")
    with pytest.raises(HlsdError, match="holds a network of 'td3'"):
        Checkpoint.load(files["td3"], "lics")
    cut = tmp_path / "cut.npz"
    cut.write_bytes(files["td3"].read_bytes()[:1000])
    with pytest.raises(HlsdError, match=r"convert-checkpoint td3 FILE"):
        Checkpoint.load(cut, "td3")


def _text(folder):
    return folder.joinpath("text").write_text("no pickle\n", encoding="utf-8")


@pytest.mark.parametrize("kind", sorted(NEED_CHECKPOINTS))
def test_the_planners_keep_the_whole_contract(kind, files, monkeypatch):
    def cheap(self, ranges_m, goal):  # the networks take milliseconds
        return np.array([ranges_m.mean() / 5, goal[1]], np.float32)

    monkeypatch.setattr(LicsTransformer, "__call__", cheap)
    monkeypatch.setattr(ResidualNetwork, "__call__", cheap)
    options = (("checkpoint", str(files[kind])),)
    contract.check_planner(lambda: make_planner(kind, options=options))
    with pytest.raises(HlsdError, match=rf"'{kind}\(checkpoint=x.npz\)'"):
        make_planner(kind)


def seen(time_s=0.0, x=0.0, ranges_m=None, path=((0.0, 0.0), (3.0, 0.0))):
    return Observation(
        time_s=time_s,
        ranges_m=np.full(BEAMS, 30.0) if ranges_m is None else ranges_m,
        speed=0.0,
        yaw_rate=0.0,
        pose_in_odom=np.array([x, 0.0, math.pi / 2]),
        path_in_odom=np.array(path),
        local_goal_in_base=np.array([1.0, 0.0]),
        goal_in_odom=np.array([0.0, 10.0]),
    )


def test_the_baselines_see_scaled_frames_oldest_first(files):
    """Scan, goal and last action as their environment scales them."""
    planner = make_planner("td3", options=(("checkpoint", str(files["td3"])),))
    planner.reset(Setup())
    shown = []
    actor = planner._actor

    class Spy:
        frames = actor.frames

        def __call__(self, frames):
            shown.append(frames.copy())
            return actor(frames)

    planner._actor = Spy()
    near = np.full(BEAMS, 2.0)
    near[0] = 0.05  # nearer than the lidar can see: no return
    first = planner.plan(seen(ranges_m=near))
    planner.plan(seen(0.2, x=1.0))
    begin, then = shown
    assert np.array_equal(begin[0], begin[3])
    frame = begin[0]
    assert frame[0] == 1.0
    np.testing.assert_allclose(frame[1:BEAMS], (2.0 - 2.5) / 5 * 2, rtol=1e-6)
    # The goal is 10 m ahead; nothing was done yet, and 0 m/s is -1/3 of -1 ... 2.
    np.testing.assert_allclose(
        frame[BEAMS:], [10 / 5 - 1, -1.0, -1 / 3, 0.0], atol=1e-6
    )
    assert np.array_equal(then[:3], begin[1:])
    np.testing.assert_allclose(then[3, :BEAMS], 1.0)
    np.testing.assert_allclose(
        then[3, BEAMS:],
        [1.0, 1 / 5 - 1, (first.speed - 0.5) / 1.5, first.yaw_rate / 3.14],
        atol=1e-6,
    )
    action = actor(begin)
    assert first.speed == pytest.approx(0.5 + 1.5 * action[0], abs=1e-6)
    assert first.yaw_rate == pytest.approx(3.14 * action[1], abs=1e-6)


def test_lics_slows_down_for_what_is_ahead(files):
    planner = make_planner(
        "lics",
        options=(("checkpoint", str(files["lics"])), ("min_speed", -9.0)),
    )
    planner.reset(Setup())
    planner._network = lambda ranges, goal: np.array([0.8, -2.0], np.float32)
    free = planner.plan(seen())
    assert (free.speed, free.yaw_rate) == (pytest.approx(1.2), -1.2)
    for beam, slowed in ((252, 1.0), (253, 0.4), (466, 0.4), (467, 1.0)):
        ranges = np.full(BEAMS, 30.0)
        ranges[beam] = 1.0
        command = planner.plan(seen(ranges_m=ranges))
        assert command.speed == pytest.approx(1.2 * slowed)


def test_lics_s_goal_is_a_direction_along_the_path():
    facing = np.array([0.0, 0.0, math.pi / 2])
    straight = [(0.0, y) for y in np.arange(0, 5, 0.05)]
    bent = [(0.0, y) for y in np.arange(0, 1, 0.05)]
    bent += [(x, 1.0) for x in np.arange(0.05, 4, 0.05)]
    goal = local_goal(np.array(straight), facing, 2.0)
    np.testing.assert_allclose(goal, (1.0, 0.0), atol=1e-9)
    goal = local_goal(np.array(bent), facing, 2.0)
    np.testing.assert_allclose(goal, (0.5, -math.sqrt(0.75)), atol=0.03)
    # A path that begins elsewhere is followed by its own direction.
    away = np.array(straight) + np.array((0.3, 0.2))
    np.testing.assert_allclose(local_goal(away, facing, 2.0), (1.0, 0.0), atol=1e-9)
    short = np.array([(0.0, 0.0), (-1.0, 0.0)])
    np.testing.assert_allclose(local_goal(short, facing, 2.0), (0.0, 1.0), atol=1e-9)
    assert not local_goal(np.empty((0, 2)), facing, 2.0).any()


def test_a_robot_with_another_lidar_is_refused(files):
    planner = make_planner("lics", options=(("checkpoint", str(files["lics"])),))
    with pytest.raises(HlsdError, match="720 beams, and the robot's lidar has 360"):
        planner.reset(Setup(lidar=LidarSpec(360)))


def test_a_run_knows_its_checkpoint_by_its_digest(tmp_path, monkeypatch):
    """The same name with other numbers is another run; it drives in a bench."""
    monkeypatch.chdir(tmp_path)
    digests = []
    spelled = ("mine=td3(checkpoint=x.npz)",)
    bench = Bench(spelled, worlds="0", trials=1, protocol="barn2024")
    for last in (0.0, 0.5):
        state = {**STATES["td3"], "fc.bias": torch.tensor([last, 0.0])}
        (tmp_path / "x.npz").unlink(missing_ok=True)
        convert("td3", str(dumped(tmp_path / "actor", state))).save(Path("x.npz"))
        digests.append(resolve(bench).planner_sha256)
    assert digests[0] != digests[1]
    rows = load_run(run_bench(bench, tmp_path / "run", Serial())).episodes
    assert rows["planner"].tolist() == ["mine"]
    assert rows["reason"].tolist() == [""]
    assert rows["path_length_m"].iloc[0] > 0.5


def test_the_command_converts_and_refuses(files, tmp_path):
    def call(*arguments):
        return CliRunner().invoke(app, ["convert-checkpoint", *map(str, arguments)])

    source, out = files["lics"].with_name("lics_actor"), tmp_path / "x.npz"
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    done = call("lics", source, "--out", out, "--sha256", digest, "--json")
    assert done.exit_code == 0, done.exception
    told = json.loads(done.stdout)
    assert told["source_sha256"] == digest
    assert told["numbers"] == sum(t.numel() for t in STATES["lics"].values())
    assert out.read_bytes() == files["lics"].read_bytes()
    for arguments, fragment in (
        (("lics", source, "--out", out), "exists already"),
        (("lica", source, "--out", tmp_path / "y.npz"), "did you mean 'lics'"),
        (
            ("lics", source, "--out", tmp_path / "y.npz", "--sha256", "12ab"),
            "not 12ab: it is another file",
        ),
        (("td3", tmp_path / "none", "--out", tmp_path / "y.npz"), "none"),
        (("lics", "https://x.invalid/a", "--out", tmp_path / "y"), "--sha256"),
    ):
        refused = call(*arguments)
        assert isinstance(refused.exception, HlsdError)
        assert fragment in str(refused.exception)
    assert not (tmp_path / "y.npz").exists()


def test_a_download_is_pinned_by_its_digest(files, tmp_path):
    source = files["lics"].with_name("lics_actor")
    handler = lambda *args: http.server.SimpleHTTPRequestHandler(  # noqa: E731
        *args, directory=source.parent
    )
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        handler_class = http.server.SimpleHTTPRequestHandler
        quiet = lambda *args: None  # noqa: E731
        before, handler_class.log_message = handler_class.log_message, quiet
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}/{source.name}"
        digest = hashlib.sha256(source.read_bytes()).hexdigest()
        try:
            held = convert("lics", address, digest)
            assert held.as_bytes() == files["lics"].read_bytes()
            with pytest.raises(HlsdError, match="it is another file than"):
                convert("lics", address, "0" * 64)
            with pytest.raises(HlsdError, match="cannot download"):
                convert("lics", f"{address}-not", digest)
        finally:
            handler_class.log_message = before
            server.shutdown()
