//! Matching and focal length against the reference.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it read"
)]
#![allow(dead_code, unused_imports, reason = "the reader of goldens serves two tests")]

mod goldens;

use goldens::{Golden, root, stated, with_tensors};
use selenograph_engine::Simd;
use selenograph_engine::focal::{bound_focal, focal_of_pointmap, median_focal_of_pointmap};
use selenograph_engine::matching::{
    Described, DescriptorMap, Matcher, PixelIndex, PixelPair, inside_border, reciprocal_symmetric,
};

/// The reference iterates in f32.
const FOCAL_ROUNDING: f64 = 1e-5;

/// A product and a root in f32.
const CONFIDENCE_ROUNDING: f32 = 1e-6;

fn levels() -> Vec<Simd> {
    [Simd::Plain, Simd::Avx2, Simd::Avx512].into_iter().filter(|level| level.is_present()).collect()
}

fn map<'a>(golden: &'a Golden, name: &str) -> DescriptorMap<'a> {
    let shape = golden.shape(name);
    DescriptorMap { height_px: shape[0], width_px: shape[1], dim: shape[2], values: golden.values(name) }
}

fn pixels(golden: &Golden, name: &str) -> Vec<PixelIndex> {
    golden.values(name).chunks_exact(2).map(|p| [p[0] as u32, p[1] as u32]).collect()
}

fn pairs(golden: &Golden, name: &str) -> Vec<PixelPair> {
    let (a, b) = (pixels(golden, &format!("{name}.xy1")), pixels(golden, &format!("{name}.xy2")));
    a.into_iter().zip(b).map(|(a, b)| [a, b]).collect()
}

/// The spacings of starts of which a file holds the matches: `S8` for one in eight pixels.
fn spacings(golden: &Golden) -> Vec<usize> {
    let number = |name: &String| name.strip_prefix('S')?.strip_suffix(".xy1")?.parse().ok();
    golden.0.keys().filter_map(number).collect()
}

#[test]
fn shared_golden_matching() {
    let Some(root) = root("golden matching") else { return };
    for file in with_tensors(&root, &["desc1", "desc2", "bf.nnA", "tol.xy1"]) {
        let golden = Golden::open(&file);
        let (first, second) = (map(&golden, "desc1"), map(&golden, "desc2"));
        let sizes = [(first.width_px, first.height_px), (second.width_px, second.height_px)];
        let indices = |name: &str| golden.values(name).iter().map(|v| *v as u32).collect::<Vec<_>>();
        assert!(!spacings(&golden).is_empty());
        for level in levels() {
            let mut matcher = Matcher::with_simd(first, second, level).unwrap();
            for subsample in spacings(&golden) {
                let found = matcher.reciprocal(subsample).unwrap();
                assert_eq!(found, pairs(&golden, &format!("S{subsample}")), "{level:?}");
                let keep = format!("S{subsample}.keep");
                let Some(border) = stated(&root, &keep, "border filter (") else { continue };
                let is_kept = |pair: &PixelPair| inside_border(*pair, sizes, border as usize);
                let kept: Vec<f32> = found.iter().map(|pair| f32::from(u8::from(is_kept(pair)))).collect();
                assert_eq!(kept, golden.values(&keep));
            }
            assert_eq!(matcher.nearest_of_all(), indices("bf.nnA"), "{level:?}");
            if let Some(tolerance_px) = stated(&root, "tol.init_x", "pixel_tol=") {
                let starts = indices("tol.init_x").into_iter().zip(indices("tol.init_y"));
                let starts: Vec<PixelIndex> = starts.map(|(x, y)| [x, y]).collect();
                let mut found = matcher.match_points(&starts, tolerance_px).unwrap();
                let mut expected = pairs(&golden, "tol");
                found.sort_unstable();
                expected.sort_unstable();
                assert_eq!(found, expected, "{level:?}");
            }
            let mut reversed = Matcher::with_simd(second, first, level).unwrap();
            assert_eq!(reversed.nearest_of_all(), indices("bf.nnB"), "{level:?}");
            // Dense: by its definition.
            let (forward, backward) = (indices("bf.nnA"), indices("bf.nnB"));
            let mutual =
                forward.iter().enumerate().filter(|(idx, to)| backward[**to as usize] as usize == *idx);
            assert_eq!(matcher.reciprocal_dense().len(), mutual.count());
        }
    }
}

#[test]
fn shared_golden_matching_drops_long_chains() {
    let Some(root) = root("golden chain") else { return };
    let Some(subsample) = stated(&root, "chain.xy1", "subsample ") else { return };
    for file in with_tensors(&root, &["chain.desc1", "chain.desc2", "chain.xy1"]) {
        let golden = Golden::open(&file);
        for level in levels() {
            let chain = (map(&golden, "chain.desc1"), map(&golden, "chain.desc2"));
            let mut matcher = Matcher::with_simd(chain.0, chain.1, level).unwrap();
            let found = matcher.reciprocal(subsample as usize).unwrap();
            assert_eq!(found, pairs(&golden, "chain"), "{level:?}");
        }
    }
}

#[test]
fn shared_golden_matching_both_ways() {
    /// The published spacing of starts; the file does not say.
    const SUBSAMPLE: usize = 8;
    let Some(root) = root("golden symmetric matching") else { return };
    for file in with_tensors(&root, &["desc1", "desc2", "sym.xy1", "sym.conf"]) {
        let golden = Golden::open(&file);
        let described = |map_name: &str, confidence: &str| Described {
            map: map(&golden, map_name),
            confidence: golden.values(confidence),
        };
        let ways = [
            [described("desc1", "sym.qonf11"), described("desc2", "sym.qonf21")],
            [described("sym.desc12", "sym.qonf12"), described("sym.desc22", "sym.qonf22")],
        ];
        let found = reciprocal_symmetric(ways, SUBSAMPLE).unwrap();
        let mut expected: Vec<(PixelPair, f32)> =
            pairs(&golden, "sym").into_iter().zip(golden.values("sym.conf").iter().copied()).collect();
        expected.sort_by_key(|(pair, _)| pair.map(|[x, y]| [y, x]));
        assert_eq!(found.len(), expected.len());
        for ((pair, confidence), (expected_pair, expected)) in found.iter().zip(&expected) {
            assert_eq!(pair, expected_pair);
            assert!(
                (confidence - expected).abs() <= CONFIDENCE_ROUNDING * expected,
                "{confidence} {expected}"
            );
        }
    }
}

#[test]
fn equal_descriptors_give_the_first() {
    // Two columns of equal descriptors far apart, in tiles that are searched in another order.
    let (height, width, dim) = (20, 20, 4);
    let mut values = vec![0.0_f32; height * width * dim];
    for pixel in [25, 3 + 19 * width, 17] {
        values[pixel * dim] = 1.0;
    }
    let map = DescriptorMap { height_px: height, width_px: width, dim, values: &values };
    for level in levels() {
        let nearest = Matcher::with_simd(map, map, level).unwrap().nearest_of_all();
        assert_eq!(nearest[25], 17, "{level:?}");
        assert_eq!(nearest[0], 0, "all products are zero: the first pixel");
    }
    let short = DescriptorMap { values: &values[1..], ..map };
    assert!(Matcher::new(short, map).is_err());
    assert!(Matcher::new(map, DescriptorMap { dim: 2, width_px: 40, ..map }).is_err());
    assert!(Matcher::new(map, map).unwrap().reciprocal(0).is_err());
    assert!(Matcher::new(map, map).unwrap().match_points(&[[20, 0]], 5.0).is_err());
}

/// Sixteenths, so that all products are exact and many are equal; coarse tiles, rounded bytes and longest
/// descriptors may rule out nothing that counts.
#[test]
fn nearest_by_its_definition() {
    let sixteenths = |count: usize, seed: usize| -> Vec<i32> {
        let noise = |k: usize| (k + seed).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
        (0..count).map(|k| (noise(k) % 17) as i32 - 8 + if k % 977 < 3 { 24 } else { 0 }).collect()
    };
    for dim in [5, 24, 32, 33] {
        let sizes = [(19, 23), (41, 18)];
        let exact = [0, 1].map(|idx| sixteenths(sizes[idx].0 * sizes[idx].1 * dim, 1000 * idx));
        let values = [0, 1].map(|idx| exact[idx].iter().map(|v| *v as f32 / 16.0).collect::<Vec<_>>());
        let expected: Vec<u32> = exact[0]
            .chunks_exact(dim)
            .map(|query| {
                let product = |row: &[i32]| row.iter().zip(query).map(|(a, b)| a * b).sum::<i32>();
                let all = exact[1].chunks_exact(dim).map(product).enumerate();
                all.max_by_key(|(idx, product)| (*product, std::cmp::Reverse(*idx))).unwrap().0 as u32
            })
            .collect();
        for level in levels() {
            let [first, second] = [0, 1].map(|idx| DescriptorMap {
                height_px: sizes[idx].0,
                width_px: sizes[idx].1,
                dim,
                values: &values[idx],
            });
            let found = Matcher::with_simd(first, second, level).unwrap().nearest_of_all();
            assert_eq!(found, expected, "{level:?} {dim}");
        }
    }
}

#[test]
fn shared_golden_focal() {
    let Some(root) = root("golden focal") else { return };
    for file in with_tensors(&root, &["focal.pts3d", "focal.pp", "focal.weiszfeld"]) {
        let golden = Golden::open(&file);
        let shape = golden.shape("focal.pts3d");
        let principal = golden.values("focal.pp");
        let principal = [f64::from(principal[0]), f64::from(principal[1])];
        let found = focal_of_pointmap(golden.values("focal.pts3d"), shape[1], principal).unwrap();
        let close = |found: f64, name: &str| {
            let expected = f64::from(golden.values(name)[0]);
            assert!((found / expected - 1.0).abs() < FOCAL_ROUNDING, "{name}: {found} {expected}");
        };
        close(found, "focal.weiszfeld");
        close(bound_focal(found, (shape[1], shape[0]), (2.0, 3.5)), "focal.weiszfeld_clipped");
        let median = median_focal_of_pointmap(golden.values("focal.pts3d"), shape[1], principal).unwrap();
        close(median, "focal.median");
    }
}

#[test]
fn points_at_the_camera_have_no_focal_length() {
    assert_eq!(focal_of_pointmap(&[0.0; 12], 2, [1.0, 1.0]), None);
    assert_eq!(median_focal_of_pointmap(&[0.0; 12], 2, [1.0, 1.0]), None);
}

#[test]
fn descriptors_that_are_no_numbers_match_nothing() {
    let (height, width, dim) = (9, 10, 3);
    let mut values: Vec<f32> =
        (0..height * width * dim).map(|k| ((k * 7919 + 13) % 1009) as f32 - 504.0).collect();
    values[44 * dim] = f32::NAN;
    let map = DescriptorMap { height_px: height, width_px: width, dim, values: &values };
    let found = Matcher::new(map, map).unwrap().reciprocal_dense();
    assert!(!found.is_empty());
    assert!(found.iter().all(|pair| pair[0] != [4, 4] && pair[1] != [4, 4]));
}
