#!/bin/sh
# Our engine beside PyTorch, full size, in turns in one run: benches/torch/run.sh [ROUNDS [A.jpg B.jpg]]
#
# Needs cargo, Python 3 with venv and the network (once, for PyTorch), 10 GB of memory, 3 GB of disk for weights and a
# quiet machine; takes eight minutes on two cores. A and B are pictures of 512x512 pixels; without them noise is used.
# THREADS  threads of both sides (default 2)
# VENV     environment with torch, numpy, safetensors, pillow (default: made in the target folder)
# PYTHON   interpreter that makes it (default python3)
set -eu
rounds=${1:-5}
[ $# -lt 3 ] || set -- "$rounds" "$(realpath "$2")" "$(realpath "$3")"
[ $# -eq 0 ] || shift
cd "$(dirname "$0")/../.."
work=${CARGO_TARGET_DIR:-target}/torch
mkdir -p "$work"
venv=${VENV:-$work/venv}
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$venv"
"$venv/bin/python" -c 'import torch, numpy, safetensors, PIL' 2>/dev/null ||
    "$venv/bin/pip" install -q torch numpy safetensors pillow
cargo build --release -q -p selenograph-engine --example engine_bench
"$venv/bin/python" benches/torch/bench.py "${CARGO_TARGET_DIR:-target}/release/examples/engine_bench" \
    "$work" "$rounds" "${THREADS:-2}" "$@"
