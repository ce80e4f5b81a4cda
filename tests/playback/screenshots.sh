#!/usr/bin/env bash
# Takes the docs' pictures of both viewers anew: docs/pictures/rerun.jpg and foxglove.jpg, from the bundled log, with the layouts of `unwater layout`.
# Needs what setup.sh needs, and on Debian: mesa-vulkan-drivers (rerun draws by software), chromium. A minute or two.
#   tests/playback/screenshots.sh [UNWATER]     the program; default: built here
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
root="$(cd "$here/../.." && pwd)"
cd "$root"
there="${CARGO_TARGET_DIR:-$root/target}/playback"
"$here/setup.sh"
# Foxglove Studio itself, as npm has it: 1.48, the last that is there; the app needs the React of its day.
if [ ! -d "$there/node_modules/@foxglove/studio-base" ]; then
  (cd "$there" && npm install --no-save --no-audit --no-fund --no-package-lock --ignore-scripts --loglevel=error \
    @foxglove/studio-base@1.48.0 playwright-core@1.65.1 react@17.0.2 react-dom@17.0.2)
fi
unwater="${1:-}"
if [ -z "$unwater" ]; then
  cargo build --release
  unwater="${CARGO_TARGET_DIR:-target}/release/unwater"
fi
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
"$unwater" correct sample_logs/rendered_clear.mcap -q -o "$work/clear.mcap"
"$unwater" layout "$work/clear.mcap" --rerun -q
"$unwater" layout "$work/clear.mcap" --foxglove -q
cp "$here/foxglove_screenshot.mjs" "$there/" # Node looks for libraries beside the script
"$there/venv/bin/python" "$here/rerun_screenshot.py" "$work/clear.mcap" "$work/clear.rerun.py" "$work/rerun.png" 14
node "$there/foxglove_screenshot.mjs" "$work/clear.mcap" "$work/clear.foxglove.json" "$work/foxglove.png" 14
"$there/venv/bin/python" - "$work" docs/pictures <<'PY'
import pathlib, sys
from PIL import Image
work, pictures = map(pathlib.Path, sys.argv[1:])
for name in ("rerun", "foxglove"):
    with Image.open(work / f"{name}.png") as picture:
        picture.convert("RGB").resize((1440, 810), Image.Resampling.LANCZOS).save(pictures / f"{name}.jpg", quality=82)
PY
