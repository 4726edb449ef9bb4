"""A program that speaks the protocol and misbehaves as its argument or file is named.

It does so at the second plan, or where its name says; it imports little, to start soon.
"""

import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import msgpack

how = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).stem
LENGTH = struct.Struct("<I")
plans = 0


def put(content):
    sys.stdout.buffer.write(LENGTH.pack(len(content)) + content)
    sys.stdout.buffer.flush()


def act(question):
    match how:
        case "exits":
            print("it ends\x1b[31m", file=sys.stderr, flush=True)
            sys.exit(3)
        case "exits-well":
            sys.exit(0)
        case "segfaults":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        case "silent":
            time.sleep(60)
        case "stops":
            os.kill(os.getpid(), signal.SIGSTOP)
        case "prints":
            print("speed is 0.3", flush=True)
        case "no-msgpack":
            put(b"\xc1")
        case "no-map":
            put(msgpack.packb([1, 2]))
        case "long":
            sys.stdout.buffer.write(LENGTH.pack(1 << 31))
            sys.stdout.buffer.flush()
        case "half":
            sys.stdout.buffer.write(LENGTH.pack(100) + b"abc")
            sys.stdout.buffer.flush()
            time.sleep(60)
        case "closes-stdout":
            os.close(1)
            time.sleep(60)
        case "closes-stdin":
            os.close(0)
            put(msgpack.packb({"type": "plan", "number": question["number"]}))
            time.sleep(60)
        case "other-number":
            put(msgpack.packb({"type": "plan", "number": 1}))
        case "other-type":
            put(msgpack.packb({"type": "reset", "number": question["number"]}))
        case "twice":
            answer(question, speed=0.1, yaw_rate=0.0)
            answer(question, speed=0.1, yaw_rate=0.0)
        case "error":
            answer(question, kind="error", text="no\nway", trace="line 1\nline 2")
        case "no-speed":
            answer(question, yaw_rate=0.0)
        case "text-speed":
            answer(question, speed="fast", yaw_rate=0.0)
        case "nan":
            answer(question, speed=float("nan"), yaw_rate=0.0)
        case "mode":
            answer(question, speed=0.0, yaw_rate=0.0, mode="fly")
        case "whole-numbers":
            answer(question, speed=1, yaw_rate=0, mode="rotate")
        case "talks":
            for _ in range(100):
                sys.stderr.write("x" * 10_000)
            answer(question, speed=0.5, yaw_rate=0.0)
        case "slow":
            time.sleep(0.7)
            answer(question, speed=0.5, yaw_rate=0.0)
        case "starts-others":
            subprocess.Popen(["sleep", "617"])
            answer(question, speed=0.5, yaw_rate=0.0)
        case _:
            answer(question, speed=0.5, yaw_rate=0.0)


def answer(question, kind=None, **more):
    held = {"type": kind or question["type"], "number": question["number"]}
    put(msgpack.packb(held | more))


HELLO = {"protocol": 1, "period_s": 0.05}
HELLOS = {
    "hello-version": {"protocol": 2},
    "hello-no-version": {"protocol": None},
    "hello-period": {"period_s": 0},
    "hello-typo": {"plan_evry_s": 0.1},
    "hello-scan": {"scan": "float16"},
    "hello-fresh": {"fresh_process": 1},
    "fresh": {"fresh_process": True},
    "wishes": {"scan": "float64", "plan_every_s": 0.25},
}

if how == "deaf":
    time.sleep(60)
while head := sys.stdin.buffer.read(4):
    question = msgpack.unpackb(sys.stdin.buffer.read(*LENGTH.unpack(head)))
    if question["type"] == "hello":
        if how == "hello-silent":
            time.sleep(60)
        answer(question, **HELLO | HELLOS.get(how, {}))
    elif question["type"] == "reset":
        if how == "reset-exits" and question["seed"]:
            sys.exit(5)
        plans = 0
        answer(question)
    elif question["type"] == "plan":
        plans += 1
        if how == "steady":
            answer(question, speed=0.1, yaw_rate=0.0)
        elif plans == 2:
            act(question)
        else:
            # Who it is, for the tests of that.
            answer(question, speed=os.getpid() / 1e8, yaw_rate=0.0)
    elif how == "stays":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(60)
    else:
        break

if how == "survives":
    time.sleep(60)
