#!/usr/bin/env bash
# Have Debian's packages that are named; what needs them works less well without, or says so.
# As root they are installed; otherwise one line tells the command that would.
set -euo pipefail

missing=()
for package in "$@"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' ||
    missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

say() { echo "cohelm set-up: $*" >&2; }

if ! command -v apt-get >/dev/null; then
  say "not a Debian: these packages may be missing: ${missing[*]}"
elif [ "$(id -u)" != 0 ]; then
  say "for all of cohelm, run once: sudo apt-get install ${missing[*]}"
else
  say "installing ${missing[*]}"
  { apt-get update -qq &&
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
  } </dev/null >/dev/null || say "could not install ${missing[*]}; going on without"
fi
