#!/usr/bin/env bash
# build.sh [FOLDER]: three.js and uPlot as one file of ES modules, with the style sheet of uPlot and both licences.
# The versions and their checksums are those of package-lock.json; npm runs no script of a package.
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
target=${1:-$(cd "$here/../.." && pwd)/src/pavetwin/app/static}
if ! command -v npm > /dev/null; then
    echo "npm is missing: install the Debian packages nodejs and npm." >&2
    exit 2
fi

cd "$here"
npm ci --ignore-scripts --no-audit --no-fund --loglevel=error
version() { node -p "require('./node_modules/$1/package.json').version"; }
banner="/*! three $(version three), uPlot $(version uplot); MIT, see vendor-licences.txt */"
mkdir -p "$target"
node node_modules/esbuild/bin/esbuild vendor.js --bundle --minify --format=esm --target=es2022 --legal-comments=none \
    --charset=utf8 --log-level=warning --banner:js="$banner" --outfile="$target/vendor.js"
{ echo "$banner"; cat node_modules/uplot/dist/uPlot.min.css; } > "$target/vendor.css"
for package in three uplot; do
    printf '%s %s\n\n' "$package" "$(version $package)"
    cat "node_modules/$package/LICENSE"
    printf '\n'
done > "$target/vendor-licences.txt"
wc -c "$target"/vendor*
