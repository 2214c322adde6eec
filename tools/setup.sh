#!/usr/bin/env bash
# Make .venv hold what uv.lock names: all of cohelm, and with `tools/setup.sh peers` also the
# software that it is measured against.
# Needs Python >= 3.11. Takes uv from PATH, else puts it into .uv/ inside this checkout.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "cohelm set-up: $*" >&2; exit 1; }

# Debian ships python3 without the means to make a virtual environment.
need_venv() {
  python3 -c 'import ensurepip, venv' 2>/dev/null && return
  [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null ||
    fail "this Python cannot make virtual environments; run: sudo apt-get install python3-venv"
  echo "cohelm set-up: installing python3-venv" >&2
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq python3-venv; } \
    </dev/null >&2 || fail "could not install python3-venv; run: apt-get install python3-venv"
}

# `uv --version` and not `command -v uv`: a version manager's shim can be there without its uv.
if uv --version >/dev/null 2>&1; then
  uv=uv
else
  uv=.uv/bin/uv
  if ! "$uv" --version >/dev/null 2>&1; then
    python3 --version >/dev/null 2>&1 ||
      fail "no python3 found; install Python 3.11 or newer (Debian: apt-get install python3 python3-venv)"
    need_venv
    echo "cohelm set-up: getting uv into .uv/" >&2
    python3 -m venv --clear .uv
    .uv/bin/python -m pip install --quiet --disable-pip-version-check "uv>=0.7"
  fi
fi

"$uv" python find '>=3.11' >/dev/null 2>&1 ||
  fail "no Python 3.11 or newer found; install one (Debian 12: apt-get install python3)"

peers=(--no-extra peers)
[ "${1:-}" != peers ] || peers=()
# compiled here once: where PYTHONDONTWRITEBYTECODE is set, each process would compile all it imports
"$uv" sync --frozen --compile-bytecode --all-extras "${peers[@]}"
