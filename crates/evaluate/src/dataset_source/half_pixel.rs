//! Are principal points where the files put them? Found from the truth itself, mended, and told.

use super::entry::{Entry, spread};
use super::load::{depth_view, read_truth};
use super::pixel_fault::PixelFault;
use selenograph_dataset::check::principal_point::{self, PrincipalPoint, Verdict};

/// Pairs that are asked; the fit of a few already tells half a pixel from none by tens of sigmas.
const NUM_ASKED: usize = 8;
/// Every this many pixels across and down are warped.
const STEP: usize = 4;

/// Asks some pairs; what the user said of triplets (`is_told`) holds, and is contradicted aloud.
pub fn find(entries: &[Entry], is_told: bool) -> PixelFault {
    let mut fault = PixelFault { shift_half_pixels: 0, told: None };
    let evidence: Vec<_> = spread(entries.iter().collect(), NUM_ASKED.min(entries.len()))
        .into_iter()
        .filter_map(|entry| read_truth(&entry.pair.open().ok()?, &fault).ok())
        .filter_map(|(truth, _)| {
            let [a, b] = truth.views.each_ref().map(depth_view);
            principal_point::evidence(&a, &b, STEP)
        })
        .collect();
    if let Some(point) = principal_point::combine(&evidence) {
        decide(&point, is_told, &mut fault);
    }
    fault
}

fn decide(point: &PrincipalPoint, is_told: bool, fault: &mut PixelFault) {
    let half_pixels = match point.verdict {
        Verdict::HalfPixelMore => 1,
        Verdict::HalfPixelLess => -1,
        Verdict::Other => {
            fault.told = Some(format!(
                "principal points are off, and not by half a pixel, so nothing is corrected: {point}"
            ));
            return;
        }
        Verdict::AsTold | Verdict::CannotTell => return,
    };
    if is_told {
        fault.told = Some(format!("principal points are not where --k-convention puts them: {point}"));
    } else {
        fault.shift_half_pixels = half_pixels;
        fault.told = Some(format!("principal points corrected by half a pixel: they are {point}"));
    }
}
