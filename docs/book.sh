#!/usr/bin/env bash
# Makes a site of the docs in target/book: needs mdbook (`cargo install mdbook`). The book holds the repository's files where they lie in it, so
# that links read the same there and on a forge.
set -euo pipefail
cd "$(dirname "$0")/.."
book="${CARGO_TARGET_DIR:-target}/book"
rm -rf "$book" && mkdir -p "$book/src"
git ls-files -z -- '*.md' 'docs/pictures' 'src/**' 'tests/*.rs' 'tests/*.py' 'tests/**' 'examples/**' 'benches/**' 'sample_logs/**' 'LICENSE*' | xargs -0 cp --parents -t "$book/src"
cp docs/book.toml "$book/"
# docs/SUMMARY.md seen from the root
sed -e 's#](\.\./#](@#' -e 's#](\([a-z]\)#](docs/\1#' -e 's#](@#](#' docs/SUMMARY.md > "$book/src/SUMMARY.md"
mdbook build "$book"
echo "$book/book/index.html"
