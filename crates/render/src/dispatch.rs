//! One kernel, three instruction sets.

use crate::InstructionSet;
use crate::brdf::Prepared;
use crate::job::Job;
use crate::kernel::radiance_tile;
use crate::simd::scalar;
#[cfg(target_arch = "x86_64")]
use crate::simd::{avx2, avx512};
use crate::tile::Tile;

/// Renders a tile with the instruction set of the job's settings, which [`crate::RadianceSettings::validate`] has found on
/// this machine.
pub(crate) fn tile(job: &Job<'_>, tile: &Tile, brdf: &Prepared, xy: [usize; 2], out: &mut [f32]) {
    match job.settings.instruction_set {
        // SAFETY: the settings were validated, so the machine has the instructions.
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => unsafe { tile_avx512(job, tile, brdf, xy, out) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => unsafe { tile_avx2(job, tile, brdf, xy, out) },
        _ => radiance_tile::<scalar::F>(job, tile, brdf, xy, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl")]
fn tile_avx512(job: &Job<'_>, tile: &Tile, brdf: &Prepared, xy: [usize; 2], out: &mut [f32]) {
    radiance_tile::<avx512::F>(job, tile, brdf, xy, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn tile_avx2(job: &Job<'_>, tile: &Tile, brdf: &Prepared, xy: [usize; 2], out: &mut [f32]) {
    radiance_tile::<avx2::F>(job, tile, brdf, xy, out);
}
