#!/usr/bin/env bash
# Builds the wheel into target/dist and tries it in a fresh environment.
set -euo pipefail
cd "$(dirname "$0")/.."
out="${CARGO_TARGET_DIR:-$PWD/target}/dist"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/build"
"$work/build/bin/pip" install --quiet 'maturin>=1.7,<2'
mkdir -p "$out"
rm -f "$out"/unwater-*.whl
(cd dist && "$work/build/bin/maturin" build --release --locked --out "$out")

python3 -m venv "$work/fresh"
"$work/fresh/bin/pip" install --quiet --no-index "$out"/unwater-*.whl
dist/try.sh "$work/fresh/bin/unwater"
