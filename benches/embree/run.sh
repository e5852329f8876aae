#!/bin/sh
# Our renderer beside Embree on one scene, interleaved in one run: benches/embree/run.sh [ROUNDS]
#
# Needs g++, Embree 3 (Debian: libembree-dev), Python with numpy, cargo, 6 GB of memory and a quiet machine.
# SELENOGRAPH_SHARED  folder with bench/gen_terrain.py (default ../shared, from the workspace's root)
# PYTHON              interpreter that has numpy (default python3)
# THREADS             threads of both sides (default 2)
# AZIMUTH             of the Sun, degrees clockwise from north (default 30)
set -eu
cd "$(dirname "$0")/../.."
rounds=${1:-3}
threads=${THREADS:-2}
azimuth=${AZIMUTH:-30}
generator=$(realpath "${SELENOGRAPH_SHARED:-../shared}/bench/gen_terrain.py")
work=${CARGO_TARGET_DIR:-target}/embree
mkdir -p "$work"
terrain=$(realpath "$work")/terrain_4096.npy
[ -f "$terrain" ] || (cd "$work" && "${PYTHON:-python3}" "$generator")
g++ -O3 -march=native -ffast-math -fno-finite-math-only -std=c++17 -Wall -Wextra \
    -o "$work/embree_bench" benches/embree/embree_bench.cpp -lembree3 -lpthread
cargo build --release -q -p selenograph-render --example render_bench
ours=${CARGO_TARGET_DIR:-target}/release/examples/render_bench

log=$work/rounds.log
: > "$log"
round=0
while [ "$round" -lt "$rounds" ]; do
    round=$((round + 1))
    for geometry in grid tri; do
        "$work/embree_bench" "$terrain" "$geometry" --threads "$threads" --azimuth "$azimuth" | tee -a "$log"
        # After each of the two, so that both sides see the same machine.
        RAYON_NUM_THREADS=$threads "$ours" "$terrain" --azimuth "$azimuth" | tee -a "$log"
    done
done

# The median of all values that follow KEY= on lines that begin with PREFIX.
median() {
    sed -n "s/^$1.*$2=\([0-9.]*\).*/\1/p" "$log" | sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'
}
awk -v grid="$(median 'embree grid' wall_s)" -v tri="$(median 'embree tri' wall_s)" \
    -v ours="$(median selenograph wall_s)" -v theirs="$(median 'embree grid' mean)" -v mean="$(median '' mean_radiance)" '
BEGIN {
    best = tri < grid ? tri : grid
    printf "median seconds per picture: Embree grid %.3f, triangles %.3f, selenograph %.3f\n", grid, tri, ours
    printf "ratio to the better of Embree: %.2f\n", best / ours
    # Facets against bilinear patches, a flat datum against a round one: 1-2 %.
    printf "mean radiance factor: Embree %.6f, selenograph %.6f (%+.1f %%)\n", theirs, mean, 100 * (mean / theirs - 1)
}'
