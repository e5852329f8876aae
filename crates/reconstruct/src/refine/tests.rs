use super::*;
use selenograph_geometry::proj_string;
use selenograph_raster::resample;

/// Rough ground whose second differences grow with their lag to the power of about one, cells of 10 m.
fn rough(side: usize) -> Raster<f32> {
    let wave = |k: i32, x: f64, y: f64| {
        let f = 0.02 * 1.7f64.powi(k);
        let (c, s) = (f64::from(k) * 2.4).sin_cos();
        (f * (c * x + s * y) + f64::from(k * k)).sin() / f
    };
    Raster::from_fn(side, side, |x, y| (0..10).map(|k| wave(k, x as f64, y as f64)).sum::<f64>() as f32)
}

fn patch(heights: Raster<f32>) -> DemPatch {
    let crs = proj_string::parse("+proj=stere +lat_0=-90 +R=1737400").unwrap();
    DemPatch::new(heights, crs, &Affine::north_up(-1000.0, 1000.0, 10.0, 10.0)).unwrap()
}

#[test]
fn the_relief_that_a_coarse_model_misses_is_estimated() {
    let fine = rough(256);
    let means = resample::block_mean(&fine, 8);
    let coarse = Raster::from_fn(240, 240, |x, y| {
        let at = |x: usize| (x as f64 + 4.5) / 8.0;
        resample::bilinear(&means, at(x), at(y)).unwrap() as f32
    });
    let missing = {
        let difference = |x: usize, y: usize| f64::from(coarse[(x, y)] - fine[(x + 4, y + 4)]).powi(2);
        let sum: f64 =
            (0..240).flat_map(|y| (0..240).map(move |x| (x, y))).map(|(x, y)| difference(x, y)).sum();
        (sum / (240.0 * 240.0)).sqrt()
    };
    let found = Quality::of(&patch(coarse), 80.0, None, None);
    // Right within a factor of two is as good as a roughness tells.
    let ratio = found.missing_relief_m / missing;
    assert!((0.5..2.0).contains(&ratio), "{ratio} {found:?}");
    let given = Quality::of(&patch(fine), 80.0, Some(55.0), Some(2.0));
    assert_eq!((given.resolution_m, given.sigma_m, given.given), (55.0, 2.0, [true, true]));
}

/// A picture, and a rendering that has lost what is shorter than `coarser` cells, moved by `by` cells.
fn compared(coarser: usize, by: usize) -> Vec<Octave> {
    let relief = rough(256);
    let slopes = Raster::from_fn(192, 192, |x, y| relief[(x + 1, y)] - relief[(x, y)]);
    let moved = Raster::from_fn(192, 192, |x, y| relief[(x + by + 1, y)] - relief[(x + by, y)]);
    let means = resample::block_mean(&moved, coarser);
    let model = Raster::from_fn(192, 192, |x, y| means[(x / coarser, y / coarser)]);
    agreement::octaves(&Compared { picture: slopes, model }, 10.0)
}

#[test]
fn pictures_tell_from_which_length_on_a_model_is_right() {
    assert_eq!(agreement::judge(&[compared(1, 0)]), Verdict::Agrees { from_m: 10.0 });
    assert_eq!(agreement::judge(&[compared(4, 0), compared(4, 0)]), Verdict::Agrees { from_m: 40.0 });
    let other = agreement::judge(&[compared(1, 0), compared(1, 50)]);
    assert!(
        matches!(other, Verdict::OtherGround { picture: 1, correlation } if correlation < 0.5),
        "{other:?}"
    );
    let mut level = compared(1, 0);
    level.iter_mut().for_each(|octave| octave.contrast = 0.0);
    assert!(matches!(agreement::judge(&[level]), Verdict::TooSmooth { longest_m } if longest_m == 80.0));
}

#[test]
fn a_grid_of_other_cells_lies_on_the_same_ground() {
    let window = patch(rough(40));
    let finer = on_grid(&window, Some(4.0)).unwrap();
    assert!((finer.cell_m() - 4.0).abs() < 0.01, "{}", finer.cell_m());
    assert_eq!(finer.map_from_pixel().apply(0.0, 0.0), window.map_from_pixel().apply(0.0, 0.0));
    let [x, y] = finer.map_from_pixel().apply(50.5, 30.5);
    assert!((f64::from(finer.heights()[(50, 30)]) - window.height(x, y).unwrap()).abs() < 1e-3);
    assert!(on_grid(&window, Some(11.0)).is_err() && on_grid(&window, Some(0.0)).is_err());
    let cropped = window.cropped(3..20, 5..30).unwrap();
    assert_eq!(cropped.heights()[(0, 0)], window.heights()[(3, 5)]);
    assert_eq!(cropped.map_from_pixel().apply(0.0, 0.0), window.map_from_pixel().apply(3.0, 5.0));
    assert!(window.cropped(30..41, 0..5).is_err());
}

#[test]
fn a_change_fades_without_a_kink() {
    assert_eq!([0.0, 0.5, 1.0].map(smooth_step), [0.0, 0.5, 1.0]);
    assert!(smooth_step(0.01) < 1e-3 && smooth_step(0.99) > 1.0 - 1e-3);
}
