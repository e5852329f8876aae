#!/bin/sh
# Relative pose beside OpenCV from Python on one pair, interleaved in one run: benches/opencv/run.sh A.png B.png [FOV_DEG [ROUNDS]]
#
# Needs cargo, Python 3 with venv and the network (once, for OpenCV), and a quiet machine.
# THREADS  threads of both sides (default 2)
# PYTHON   interpreter that makes the environment (default python3)
set -eu
[ $# -ge 2 ] || { sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 1; }
a=$(realpath "$1")
b=$(realpath "$2")
fov=${3:-45}
rounds=${4:-7}
threads=${THREADS:-2}
cd "$(dirname "$0")/../.."
work=${CARGO_TARGET_DIR:-target}/opencv
mkdir -p "$work"
[ -x "$work/venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$work/venv"
"$work/venv/bin/python" -c 'import cv2' 2>/dev/null || "$work/venv/bin/pip" install -q opencv-python-headless numpy
cargo build --release -q -p selenograph-reconstruct --example pair_pose_bench
ours=${CARGO_TARGET_DIR:-target}/release/examples/pair_pose_bench

log=$work/pose_rounds.log
: > "$log"
round=0
while [ "$round" -lt "$rounds" ]; do
    round=$((round + 1))
    # Three each in turns, so that both sides see the same machine; the first of each warms it up and is left out.
    "$work/venv/bin/python" benches/opencv/pose_bench.py "$a" "$b" "$fov" 3 "$threads" | tail -n 2 | tee -a "$log"
    RAYON_NUM_THREADS=$threads "$ours" "$a" "$b" "$fov" 3 | tail -n 2 | tee -a "$log"
done

# The median of all values that follow KEY= on lines that begin with PREFIX.
median() {
    sed -n "s/^$1.* $2=\([0-9.]*\).*/\1/p" "$log" | sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'
}
for step in features matching estimate wall; do
    awk -v step="$step" -v theirs="$(median opencv "${step}_ms")" -v ours="$(median selenograph "${step}_ms")" 'BEGIN {
        printf "median %-8s OpenCV %7.1f ms, selenograph %7.1f ms, ratio %.2f\n", step, theirs, ours, ours / theirs
    }'
done
