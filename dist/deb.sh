#!/usr/bin/env bash
# Builds the Debian package into target/dist, with completions and man pages. With --try it is also
# installed in a fresh Debian below a temporary folder (root, and debootstrap, needed).
set -euo pipefail
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
cargo build --release --locked
bin="$target/release/unwater"
rm -rf "$target/dist/deb"
mkdir -p "$target/dist/deb"
"$bin" man "$target/dist/deb/man" >/dev/null
"$bin" completions bash >"$target/dist/deb/unwater.bash"
"$bin" completions zsh >"$target/dist/deb/_unwater"
"$bin" completions fish >"$target/dist/deb/unwater.fish"
rm -f "$target"/dist/unwater_*.deb
cargo deb --no-build --locked --output "$target/dist/"

if [ "${1:-}" = --try ]; then
  root="$(mktemp -d)"
  trap 'rm -rf "$root"' EXIT
  debootstrap --variant=minbase stable "$root" >/dev/null
  cp "$target"/dist/unwater_*.deb dist/try.sh "$root/tmp/"
  cp -r sample_logs "$root/tmp/"
  chroot "$root" sh -c 'apt-get install --yes --quiet /tmp/unwater_*.deb'
  chroot "$root" sh -c 'cd /tmp && ./try.sh unwater'
  test -e "$root/usr/share/man/man1/unwater-correct.1.gz"
fi
