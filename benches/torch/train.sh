#!/bin/sh
# Our training steps beside PyTorch's, full size, frozen encoder, in turns: benches/torch/train.sh [ROUNDS]
#
# Needs cargo, Python 3 with venv and the network (once, for PyTorch), 24 GB of memory and 3 GB of disk.
# THREADS  threads of both sides (default 1: then seconds of the processor can be compared on a machine that is not quiet)
# SIZE     rows and columns (default "384 512")
# STEPS    steps of each side in each round (default 2)
# KEEP     what our side keeps of the forward pass: everything, or inputs (of blocks; default)
# VENV     environment with torch, numpy, safetensors (default: made in the target folder)
# PYTHON   interpreter that makes it (default python3)
set -eu
rounds=${1:-1}
cd "$(dirname "$0")/../.."
work=${CARGO_TARGET_DIR:-target}/torch
mkdir -p "$work"
venv=${VENV:-$work/venv}
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$venv"
"$venv/bin/python" -c 'import torch, numpy, safetensors' 2>/dev/null ||
    "$venv/bin/pip" install -q torch numpy safetensors pillow
cargo build --release -q --workspace --features selenograph-cli/train --example finetune_bench
bench="${CARGO_TARGET_DIR:-target}/release/examples/finetune_bench"
# Not the file of run.sh: with it comes the batch.
weights=$work/training.safetensors
[ -e "$weights" ] || "$venv/bin/python" benches/torch/train.py make "$weights"
threads=${THREADS:-1}
steps=${STEPS:-2}
rm -f "$work/ours.jsonl" "$work/theirs.jsonl"
for _ in $(seq "$rounds"); do
    # shellcheck disable=SC2086
    RAYON_NUM_THREADS=$threads "$bench" mast3r-vitl ${SIZE:-384 512} "$steps" "${KEEP:-inputs}" "$weights" "$work/batch.safetensors" >> "$work/ours.jsonl"
    THREADS=$threads "$venv/bin/python" benches/torch/train.py run "$weights" "$work/batch.safetensors" "$steps" >> "$work/theirs.jsonl"
done
"$venv/bin/python" benches/torch/train.py table "$work/ours.jsonl" "$work/theirs.jsonl"
