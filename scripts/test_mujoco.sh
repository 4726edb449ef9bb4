#!/usr/bin/env bash
# Load exported worlds in other versions of MuJoCo, and in mujoco-warp, where a warning
# is an error. Each gets an environment of its own under build/, from uv.
#
#   PYTHON=3.11 HLSD=hlsd UV=uv scripts/test_mujoco.sh
#
# warp-lang is large, 130 MB to download; a GPU is not needed.
set -euo pipefail
cd "$(dirname "$0")/.."
unset PIP_CONSTRAINT
build=build/mujoco
mkdir -p "$build"
worlds=$(mktemp -d "$build/worlds.XXXXXX")
trap 'rm -rf "$worlds"' EXIT
for robot in jackal disc; do
    "$HLSD" worlds export barn300 0 --robot "$robot" --rangefinder \
        --out "$worlds/$robot.xml"
done
load() {
    local environment=$build/$1
    shift
    "$UV" venv --quiet --allow-existing --python "$PYTHON" "$environment"
    if ! "$UV" pip install --quiet --python "$environment/bin/python" "$@"; then
        echo "skipped $*: it cannot be installed here"
        return
    fi
    "$environment/bin/python" scripts/load_mjcf.py "$worlds"/*.xml
}
load mujoco-3.5 mujoco==3.5.0
load mujoco-4.0 mujoco==4.0.0
load warp-3.5 mujoco==3.5.0 mujoco-warp==3.5.0.2
load warp-4.0 mujoco==4.0.0 mujoco-warp==4.0.0
