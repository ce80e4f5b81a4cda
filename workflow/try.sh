#!/usr/bin/env bash
# Tries the workflow on the bundled logs: try.sh [PROGRAM]. A run that is killed goes on, and the
# dives have the bytes of the shell's commands. Needs snakemake on the path.
set -euo pipefail
cd "$(dirname "$0")/.."
program="$(realpath "${1:-target/release/unwater}")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir "$work/dives"
cp sample_logs/*.mcap "$work/dives/"

run() {
  snakemake -s workflow/Snakefile --cores 2 --rerun-incomplete --quiet all --directory "$work" \
    --config dives="$work/dives" out="$work/out" unwater="$program" shards=2
}
# Killed at three moments, with all that it started.
export work program
export -f run
for seconds in 3 3 3; do
  timeout --signal KILL "$seconds" setsid --wait bash -c run >"$work/killed.log" 2>&1 || true
  pkill -KILL -f "$work/out" || true
  echo "killed after $seconds s, with $(find "$work/out" -type f 2>/dev/null | wc -l) files"
  snakemake -s workflow/Snakefile --directory "$work" --unlock --quiet all \
    --config dives="$work/dives" out="$work/out" unwater="$program" shards=2
done
run

for dive in "$work"/dives/*.mcap; do
  name="$(basename "$dive" .mcap)"
  "$program" estimate "$dive" -o "$work/$name.json" --quiet
  "$program" correct "$dive" --model "$work/$name.json" -o "$work/$name.mcap" --quiet
  cmp "$work/$name.mcap" "$work/out/$name.corrected.mcap"
  test -s "$work/out/$name.html"
done
"$program" table "$work"/out/*.corrected.mcap --csv | cmp - "$work/out/dives.csv"
test -z "$(find "$work/out" -path '*shards/*')"
echo "the workflow's dives are those of the shell"
