#!/usr/bin/env bash
# Installs what the playback check reads logs with, into target/playback: rerun's SDK and the libraries that Foxglove decodes with;
# what makes a site of the docs, mdBook; Snakemake; and what opens the report's pages: playwright-core, and Chromium itself where Debian's packages are at hand (the tests in a browser are reported as ignored without it).
# Needs Python 3.11 or later and Node 20 or later. May be run again: what is there already is left as it is.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
there="${CARGO_TARGET_DIR:-$here/../../target}/playback"
mkdir -p "$there"
cd "$there"
if ! cmp -s "$here/requirements.txt" .installed/requirements.txt; then
  [ -x venv/bin/python ] || python3 -m venv venv
  venv/bin/pip install --quiet --disable-pip-version-check -r "$here/requirements.txt"
  venv/bin/rerun analytics disable >/dev/null # it sends usage data otherwise
  mkdir -p .installed && cp "$here/requirements.txt" .installed/
fi
if ! cmp -s "$here/package.json" .installed/package.json; then
  cp "$here/package.json" .
  npm install --no-audit --no-fund --no-package-lock --ignore-scripts --loglevel=error
  mkdir -p .installed && cp "$here/package.json" .installed/
fi
if [ ! -x /usr/bin/chromium ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium; } >/dev/null || echo "no Chromium" >&2
fi
