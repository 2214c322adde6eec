#!/usr/bin/env bash
# Ask PyPI whether every required dependency has a wheel for each Python and machine we promise.
set -euo pipefail
cd "$(dirname "$0")/.."
uv=.venv/bin/uv
failed=0
for python in 3.11 3.12 3.13 3.14; do
  for machine in x86_64 aarch64; do
    if said=$("$uv" pip compile --quiet --only-binary :all: --python-platform "$machine-manylinux_2_28" \
      --python-version "$python" pyproject.toml 2>&1 >/dev/null); then
      echo "Python $python, $machine: all there"
    else
      echo "Python $python, $machine: $said" >&2
      failed=1
    fi
  done
done
exit "$failed"
