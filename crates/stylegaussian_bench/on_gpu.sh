#!/usr/bin/env bash
# Everything that fits ten minutes on a machine with a GPU and without Rust: BENCH OUTPUT_FOLDER [PEER]
#
# Writes OUTPUT_FOLDER/quick.json and all.json with their tables beside them. The quick part comes first, so
# that there is something to keep where the whole takes too long.
set -uo pipefail
bench=${1:?the path of stylegaussian_bench}
out=${2:?a folder for what is measured}
[ $# -ge 3 ] && export STYLEGAUSSIAN_PEER_BENCH=$3
mkdir -p "$out"
timeout 150 "$bench" --quick --json "$out/quick.json" >"$out/quick.md"
timeout 430 "$bench" --json "$out/all.json" >"$out/all.md"
ls -l "$out"
