#!/usr/bin/env bash
# Run tests against declared versions, in an environment that uv makes under build/.
#
#   PYTHON=3.13 UV=uv scripts/test_bounds.sh lowest|pinned TEST...
#
# lowest: the lowest direct dependencies of pyproject.toml; pinned: those of
# constraints.txt. Without torch, which is large and only trains.
set -euo pipefail
cd "$(dirname "$0")/.."
versions=$1
shift
unset PIP_CONSTRAINT
# pyenv's commands for versions that are not chosen only say so.
if command -v pyenv >/dev/null; then
    PYENV_VERSION=$(pyenv versions --bare | grep "^${PYTHON#python}\." | tail -n 1 || true)
    if [ -n "$PYENV_VERSION" ]; then export PYENV_VERSION; else unset PYENV_VERSION; fi
fi
environment=build/bounds/$versions-$PYTHON
if ! "$UV" venv --quiet --allow-existing --python "$PYTHON" "$environment"; then
    echo "skipped: uv has no $PYTHON here and cannot get it"
    exit 0
fi
install=("$UV" pip install --quiet --python "$environment/bin/python")
warnings=()
if [ "$versions" = lowest ]; then
    "${install[@]}" --resolution lowest-direct --editable .
    # Libraries of that age, on newer ones of their own, use what goes out of use.
    warnings=(-W ignore::DeprecationWarning)
else
    "${install[@]}" --constraint constraints.txt --editable .
fi
# The tools change nothing of that.
"$UV" pip freeze --python "$environment/bin/python" | grep == >"$environment/versions.txt"
"${install[@]}" --constraint "$environment/versions.txt" pytest hypothesis PyYAML
# Kernels that another environment compiled are not for this one.
NUMBA_CACHE_DIR=$PWD/$environment/numba "$environment/bin/python" -m pytest \
    -p no:cacheprovider -m "not slow" "${warnings[@]}" "$@"
