use super::*;
use crate::rng::rng;

fn picture() -> Raster<u8> {
    Raster::from_fn(20, 12, |x, y| ((x * 37 + y * 91 + x * y * 5) % 256) as u8)
}

/// What OpenCV 5.0.0 makes of it: `bilateralFilter(bgr, 15, 75, 100)`, rows 0, 6 and 11.
const BILATERAL: [(usize, [u8; 20]); 3] = [
    (0, [15, 38, 74, 110, 148, 184, 220, 23, 44, 76, 115, 150, 188, 222, 22, 46, 79, 115, 154, 190]),
    (6, [40, 103, 168, 226, 49, 114, 179, 234, 59, 125, 189, 23, 71, 138, 201, 24, 82, 154, 213, 34]),
    (11, [223, 68, 161, 235, 89, 181, 31, 110, 199, 42, 129, 219, 61, 152, 234, 78, 168, 18, 91, 181]),
];

/// What Pillow 13.0.0 makes of row 11: `Contrast` 0.5 and 1.5, `Brightness` 1.37.
const HALF_CONTRAST: [u8; 20] =
    [181, 99, 145, 191, 109, 155, 73, 119, 165, 83, 129, 175, 93, 139, 185, 103, 149, 67, 113, 159];
const MORE_CONTRAST: [u8; 20] =
    [255, 39, 177, 255, 69, 207, 0, 99, 237, 0, 129, 255, 21, 159, 255, 51, 189, 0, 81, 219];
const BRIGHTER: [u8; 20] =
    [255, 94, 220, 255, 121, 247, 23, 149, 255, 50, 176, 255, 78, 204, 255, 105, 231, 6, 132, 255];

#[test]
fn the_bilateral_filter_is_opencvs() {
    /// Grey levels: single-precision sums in another order.
    const LEVELS: u8 = 1;
    let filtered = bilateral(&picture());
    for (y, expected) in BILATERAL {
        for (level, expected) in filtered.row(y).iter().zip(&expected) {
            assert!(level.abs_diff(*expected) <= LEVELS, "row {y}: {level} {expected}");
        }
    }
    // Below its reach in size, and flat.
    assert_eq!(bilateral(&Raster::filled(3, 2, 77)), Raster::filled(3, 2, 77));
}

#[test]
fn contrast_and_brightness_are_pillows() {
    let changed = |change: &dyn Fn(&mut Raster<u8>)| {
        let mut levels = picture();
        change(&mut levels);
        levels.row(11).to_vec()
    };
    assert_eq!(changed(&|levels| contrast(levels, 0.5)), HALF_CONTRAST);
    assert_eq!(changed(&|levels| contrast(levels, 1.5)), MORE_CONTRAST);
    assert_eq!(changed(&|levels| blend(levels, 0, 1.37)), BRIGHTER);
}

#[test]
fn steps_happen_as_often_as_asked_and_each_can_be_switched_off() {
    let off = Photometric {
        bilateral_share: 0.0,
        tint_share: 0.0,
        contrast_share: 0.0,
        jitter: 0.0,
        ..Photometric::default()
    };
    let changed = |settings: &Photometric| {
        (0..200).filter(|n| settings.apply(picture(), &mut rng(3, "test", *n, "levels")) != picture()).count()
    };
    assert_eq!(changed(&off), 0);
    assert!((80..120).contains(&changed(&Photometric { bilateral_share: 0.5, ..off.clone() })));
    assert!((40..80).contains(&changed(&Photometric { tint_share: 0.3, ..off.clone() })));
    // A factor of 1, a third of them, changes nothing.
    assert!((75..115).contains(&changed(&Photometric { contrast_share: 0.7, ..off.clone() })));
    assert_eq!(changed(&Photometric { jitter: 0.5, ..off }), 200);
}
