#!/usr/bin/env bash
# Builds the docs as a site in target/book and fails if a link in it is broken. Needs mdbook
# (`cargo install mdbook`) and Python. The book keeps the repository's paths, so that links are the
# same there and on a code hosting site.
set -euo pipefail
cd "$(dirname "$0")/.."
book="${CARGO_TARGET_DIR:-target}/book"
rm -rf "$book" && mkdir -p "$book/src"
git ls-files -z -- '*.md' 'docs/pictures' 'src/**' 'tests/**' 'examples/**' \
  'benches/**' 'sample_logs/**' 'dist/**' 'workflow/**' 'LICENSE*' |
  xargs -0 cp --parents -t "$book/src"
cp docs/book.toml "$book/"
# docs/SUMMARY.md seen from the root
sed -e 's#](\.\./#](@#' -e 's#](\([a-z]\)#](docs/\1#' -e 's#](@#](#' docs/SUMMARY.md > "$book/src/SUMMARY.md"
mdbook build "$book"
python3 - "$book/book" <<'END'
import pathlib, re, sys, urllib.parse
site = pathlib.Path(sys.argv[1])
broken = []
for page in site.rglob("*.html"):
    for link in re.findall(r'<(?:a|img)\b[^>]*?\b(?:href|src)="([^"]+)"', page.read_text()):
        address = urllib.parse.urlsplit(link)
        to = page.parent / urllib.parse.unquote(address.path) if address.path else page
        if address.scheme or page.name in ("404.html", "print.html"):
            continue  # external; at the site's root; all pages in one
        if not to.exists() or (to.suffix == ".html" and address.fragment and f'id="{urllib.parse.unquote(address.fragment)}"' not in to.read_text()):
            broken.append(f"{page.relative_to(site)}: {link}")
sys.exit("\n".join(["broken links:", *broken]) if broken else 0)
END
echo "$book/book/index.html"
