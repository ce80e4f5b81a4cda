#!/usr/bin/env bash
# Makes the pictures of docs/report.md from the bundled sample log:
#
#     docs/pictures/look.sh
#
# Needs Chromium, node and playwright-core (NODE_PATH), and Python with Pillow.
set -euo pipefail
cd "$(dirname "$0")/../.."
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
run() { cargo run --release --quiet -- "$@"; }
run correct sample_logs/rendered_clear.mcap -o "$work/clear.mcap" -q
run report "$work/clear.mcap" -q
run compare sample_logs/rendered_clear.mcap --frame 9 -o "$work/compare.png" -q
run mosaic "$work/clear.mcap" -o "$work/mosaic.png" -q
node tests/report_page.cjs --shots "$work" "$work/clear.html"
python3 - "$work" <<'PY'
import sys
from PIL import Image

work = sys.argv[1]

def save(picture, name, width):
    picture = picture.convert("RGB")
    picture.resize((width, round(picture.height * width / picture.width)), Image.LANCZOS).save(f"docs/pictures/{name}.jpg", quality=82, optimize=True)

light, dark = Image.open(f"{work}/clear.light.png"), Image.open(f"{work}/clear.dark.png")
half = light.height // 2
both = Image.new("RGB", (2 * light.width, half))
both.paste(light.crop((0, 0, light.width, half)), (0, 0))
both.paste(dark.crop((0, half, dark.width, 2 * half)), (light.width, 0))
save(both, "report", 1100)
save(Image.open(f"{work}/compare.png"), "compare", 1300)
save(Image.open(f"{work}/mosaic.png"), "mosaic", 760)
PY
