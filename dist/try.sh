#!/usr/bin/env bash
# Tries an installed program: try.sh PROGRAM. A bundled log is corrected and verified.
set -euo pipefail
program="$1"
logs="$(cd "$(dirname "$0")" && cd ../sample_logs 2>/dev/null && pwd || echo "$PWD/sample_logs")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
"$program" --version
"$program" correct "$logs/lost_beams.mcap" -o "$work/out.mcap" --quiet
"$program" verify "$work/out.mcap" --against "$logs/lost_beams.mcap"
