use super::*;
use crate::prediction::PredictedView;
use crate::priors::{KnownPose, Priors};
use crate::scale::{Placement, ScaleSource, World};
use selenograph_geometry::{
    Body, CamB, Camera, Geodetic, Point2, Point3, PredA, Rigid3, Sim3, Vector3, lookat, pixel,
};

/// Heights of a few hundred metres in f32 relative to the grid's origin: a micrometre's rounding, times some operations.
const F32_TOLERANCE: f64 = 2e-3;

fn camera() -> Camera {
    Camera::from_fov(96, 80, 0.7).unwrap()
}

/// A view from `cam_a_from_cam` of the surface that `hit` (ray origin, direction with z = 1 in the camera) finds.
fn view(
    camera: &Camera,
    a_from_cam: &Rigid3<PredA, PredA>,
    hit: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>,
) -> PredictedView {
    let points = Raster::from_fn(camera.width, camera.height, |x, y| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
        let (origin, direction) = (a_from_cam.origin(), a_from_cam.vector(&ray));
        match hit(&origin, &direction) {
            Some(t) => (origin + direction * t).coords.map(|v| v as f32).into(),
            None => [f32::NAN; 3],
        }
    });
    let there = points.map(|p| !p[0].is_nan());
    PredictedView {
        confidence: there.map(|&t| if t { 1.0 } else { 0.0 }),
        sigma: Some(there.map(|&t| if t { 0.5 } else { f32::NAN })),
        fill: there.map(|&t| if t { Fill::Measured } else { Fill::Absent }),
        points,
    }
}

fn pair(hit: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64> + Copy) -> Prediction {
    let a_from_b: Rigid3<PredA, PredA> =
        Rigid3::from_quaternion(1.0, 0.0, 0.02, 0.0, Point3::new(30.0, 2.0, 0.0));
    let cam_b_from_cam_a: Rigid3<CamB, selenograph_geometry::CamA> = a_from_b.inverse().relabel();
    Prediction {
        cam_b_from_cam_a: Ok(cam_b_from_cam_a),
        views: Some([view(&camera(), &Rigid3::identity(), hit), view(&camera(), &a_from_b, hit)]),
    }
}

/// The plane n·p = d.
fn plane(n: Vector3<f64>, d: f64) -> impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64> + Copy {
    move |origin, direction| Some((d - n.dot(&origin.coords)) / n.dot(direction))
}

/// A prediction whose unit is the metre already.
fn place_metric(prediction: &Prediction, world: World) -> Result<Placement, Error> {
    let pose = *prediction.cam_b_from_cam_a.as_ref().unwrap();
    let pose = Some(KnownPose { cam_b_from_cam_a: pose, metric: true });
    Priors { cam_b_from_cam_a: pose, world, ..Priors::default() }.place(prediction)
}

/// Camera A at the origin, looking straight down.
fn looking_down() -> World {
    let level_from_cam = lookat::from_forward_and_right::<selenograph_geometry::Enu>(
        Point3::origin(),
        &-Vector3::z(),
        &Vector3::x(),
    );
    World::Level(level_from_cam.unwrap().relabel())
}

#[test]
fn a_tilted_plane_is_flat_in_its_own_frame() {
    let prediction = pair(plane(Vector3::new(0.2, -0.3, -0.93).normalize(), -400.0));
    let placement = place_metric(&prediction, World::Unknown).unwrap();
    let (dem, _) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
    assert!(dem.frame.is_metric() && dem.frame.crs().is_none());
    assert!(dem.coverage() > 0.7, "{}", dem.coverage());
    for (i, &h) in dem.heights.data.iter().enumerate() {
        assert_eq!(h.is_nan(), dem.count.data[i] == 0);
        assert_eq!(dem.fill.data[i] == Fill::Measured, dem.count.data[i] > 0);
        // Every cell is counted once per view, also where centres fall on the edges of triangles.
        assert!(dem.count.data[i] <= 2);
        assert!(h.is_nan() || f64::from(h).abs() < F32_TOLERANCE, "{h}");
    }
    assert!(dem.count.data.contains(&2));
}

#[test]
fn heights_follow_the_vertical_where_it_is_known() {
    // A slope of 0.25 along x, looked at from 300 above in a level frame.
    let down: Rigid3<selenograph_geometry::Enu, selenograph_geometry::Cam> =
        lookat::from_forward_and_right(Point3::new(0.0, 0.0, 300.0), &-Vector3::z(), &Vector3::x()).unwrap();
    let level_from_a: Rigid3<selenograph_geometry::Enu, PredA> = down.relabel();
    let prediction = pair(move |origin, direction| {
        let (o, d) = (level_from_a.point(origin), level_from_a.vector(direction));
        Some((0.25 * o.x - o.z) / (d.z - 0.25 * d.x))
    });
    let world = World::Level(down.relabel());
    let placement = place_metric(&prediction, world).unwrap();
    let options = GridOptions { cell: Some(4.0), ..GridOptions::default() };
    let (dem, _) = grid(&prediction, &placement, &options).unwrap();
    let mut tried = 0;
    for y in 0..dem.heights.height {
        for x in 0..dem.heights.width {
            let h = f64::from(dem.heights[(x, y)]);
            if !h.is_nan() {
                let [east, _] = dem.map_from_pixel.apply(pixel::center_of(x), pixel::center_of(y));
                assert!((h - 0.25 * east).abs() < F32_TOLERANCE, "{h} at {east}");
                tried += 1;
            }
        }
    }
    assert!(tried > 1000);
}

#[test]
fn a_sphere_is_level_on_its_map() {
    let body = Body::sphere("ball", 5000.0, "ball");
    for (lat, polar) in [(-85.0, true), (20.0, false)] {
        let above = Geodetic::from_deg(lat, 40.0, 900.0);
        let axes = body.body_from_enu(&above);
        let body_from_cam: Rigid3<selenograph_geometry::BodyFixed, selenograph_geometry::Cam> =
            lookat::from_forward_and_right(
                body.point(&above),
                &-body.up(&above),
                &axes.vector(&Vector3::x()),
            )
            .unwrap();
        let body_from_a: Rigid3<selenograph_geometry::BodyFixed, PredA> = body_from_cam.relabel();
        let radius = body.radius_m + 7.0;
        let prediction = pair(move |origin, direction| {
            let (o, d) = (body_from_a.point(origin).coords, body_from_a.vector(direction));
            let (b, c) =
                (o.dot(&d) / d.norm_squared(), (o.norm_squared() - radius * radius) / d.norm_squared());
            let root = b * b - c;
            (root > 0.0).then(|| -b - root.sqrt())
        });
        let world = World::Body { body: body.clone(), body_from_cam_a: body_from_cam.relabel() };
        let placement = place_metric(&prediction, world).unwrap();
        let (dem, lifted) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
        let crs = dem.frame.crs().unwrap();
        assert_eq!(crs.projection.name().starts_with("polar"), polar);
        // The footprint is turned against the map.
        assert!(dem.coverage() > 0.3);
        // Chords of a facet lie below the sphere by at most cell² / 8R times a few.
        let sagitta = 8.0 * dem.cell * dem.cell / (8.0 * body.radius_m);
        for h in dem.heights.data.iter().filter(|h| !h.is_nan()) {
            assert!((f64::from(*h) - 7.0).abs() < sagitta + F32_TOLERANCE, "{h}");
        }
        assert!(lifted.views[1].center.is_some());
    }
}

#[test]
fn an_occluding_edge_is_not_bridged() {
    // A mesa 120 above the ground for x < 40, seen from 400 above the ground: its edge hides the ground beyond.
    let prediction = pair(|origin, direction| {
        let at = |z: f64| (z - origin.z) / direction.z;
        let mesa = at(280.0);
        let x = |t: f64| origin.x + t * direction.x;
        Some(if x(mesa) < 40.0 { mesa } else { at(400.0) })
    });
    let placement = place_metric(&prediction, World::Unknown).unwrap();
    let world = World::Level(
        lookat::from_forward_and_right::<selenograph_geometry::Enu>(
            Point3::origin(),
            &-Vector3::z(),
            &Vector3::x(),
        )
        .unwrap()
        .relabel(),
    );
    let placement = Placement { world, ..placement };
    let (dem, _) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
    let (mut high, mut low) = (0, 0);
    for h in dem.heights.data.iter().filter(|h| !h.is_nan()) {
        let (on_mesa, on_ground) = ((h + 280.0).abs() < 0.01, (h + 400.0).abs() < 0.01);
        assert!(on_mesa || on_ground, "a height between both: {h}");
        high += u32::from(on_mesa);
        low += u32::from(on_ground);
    }
    assert!(high > 500 && low > 500);
    // The hidden strip stays absent.
    assert!(dem.coverage() < 0.97);
}

#[test]
fn views_are_fused_by_inverse_variance() {
    let mut prediction = pair(plane(Vector3::z(), 400.0));
    let [a, b] = prediction.views.as_mut().unwrap();
    // B lies 3 lower and is three times less certain: h = (0·1 + 3·1/9) / (10/9) = 0.3 further away.
    for p in &mut b.points.data {
        p[2] += 3.0;
    }
    a.sigma = Some(a.confidence.map(|_| 1.0));
    b.sigma = Some(b.confidence.map(|_| 3.0));
    let placement = place_metric(&prediction, looking_down()).unwrap();
    let (dem, _) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
    // The rays of both views meet a cell at other angles: sigma of a height is that of the ray times its cosine.
    let middle = (dem.heights.width / 2, dem.heights.height / 2);
    assert_eq!(dem.count[middle], 2);
    assert!((f64::from(dem.heights[middle]) + 400.3).abs() < 0.01, "{}", dem.heights[middle]);
    // Typical variance 2 / (1 + 1/9) = 1.8, disagreement 0.9·0.09 + 0.1·7.29 = 0.81.
    let expected = (1.8f64 + 0.81).sqrt();
    assert!((f64::from(dem.sigma[middle]) - expected).abs() < 0.02 * expected, "{}", dem.sigma[middle]);
}

#[test]
fn where_a_view_ends_the_fused_heights_have_no_step() {
    let mut prediction = pair(plane(Vector3::z(), 400.0));
    // As certain as A, and 8 units lower, from its 48th column on.
    let [_, b] = prediction.views.as_mut().unwrap();
    for (i, p) in b.points.data.iter_mut().enumerate() {
        p[2] += 8.0;
        if i % 96 < 48 {
            (*p, b.fill.data[i]) = ([f32::NAN; 3], Fill::Absent);
        }
    }
    let placement = place_metric(&prediction, looking_down()).unwrap();
    let dem = grid(&prediction, &placement, &GridOptions::default()).unwrap().0;
    let row: Vec<(f32, u8)> = {
        let y = dem.heights.height / 2;
        dem.heights.row(y).iter().copied().zip(dem.count.row(y).iter().copied()).collect()
    };
    let begins = row.iter().position(|(_, count)| *count == 2).unwrap();
    // Alone, A has its own height; sixteen pixels further it is the mean of both, half of 8 off, and no cell on the way jumps.
    let (alone, mean) = (row[begins - 1].0, row[begins + 18].0);
    assert!((alone - mean).abs() > 3.5, "{alone} {mean}");
    let steps = row[begins - 3..begins + 19].windows(2).map(|two| (two[1].0 - two[0].0).abs());
    let largest = steps.fold(0.0, f32::max);
    // B's share f_b / (f_a + f_b) changes by 1/16 / (f_a + f_b) a pixel at most, and f_a is above a half: an eighth of 8. Without
    // the fading it is 4.
    assert!(largest < 1.0, "{largest}");
}

#[test]
fn completed_points_fill_only_what_nothing_measured_covers() {
    let mut prediction = pair(plane(Vector3::z(), 400.0));
    for view in prediction.views.as_mut().unwrap() {
        for (i, fill) in view.fill.data.iter_mut().enumerate() {
            if i % 96 > 60 {
                *fill = Fill::Completed;
            }
        }
    }
    let placement = place_metric(&prediction, World::Unknown).unwrap();
    let left = grid(&prediction, &placement, &GridOptions::default()).unwrap().0;
    assert!(!left.fill.data.contains(&Fill::Completed));
    let options = GridOptions { completed: Completed::Include, ..GridOptions::default() };
    let whole = grid(&prediction, &placement, &options).unwrap().0;
    let count = |dem: &Dem, fill| dem.fill.data.iter().filter(|f| **f == fill).count();
    assert_eq!(count(&left, Fill::Measured), count(&whole, Fill::Measured));
    assert!(count(&whole, Fill::Completed) > 1000);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let prediction = pair(|o, d| Some((400.0 - o.z) / d.z * (1.0 + 0.01 * (20.0 * d.x).sin())));
    let placement = place_metric(&prediction, World::Unknown).unwrap();
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let dem = pool.install(|| grid(&prediction, &placement, &GridOptions::default()).unwrap().0);
        dem.heights.data.iter().map(|h| h.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(bits(1), bits(3));
}

#[test]
fn without_a_scale_lengths_are_baselines() {
    let prediction = pair(plane(Vector3::z(), 400.0));
    let placement = Priors::default().place(&prediction).unwrap();
    assert!(!placement.metric && placement.source.is_none());
    let baseline = crate::scale::baseline(&prediction).unwrap();
    assert!((placement.cam_a_from_pred.scale() * baseline - 1.0).abs() < 1e-12);
    let (dem, _) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
    assert!(!dem.frame.is_metric());
    assert!(dem.cell < 1.0);
    let body = World::Body { body: Body::moon(), body_from_cam_a: Rigid3::identity() };
    let unplaced = Placement { world: body, ..placement };
    assert!(unplaced.body_from_pred().is_none(), "no place on a body without a scale");
}

#[test]
fn empty_predictions_and_absurd_cells_are_errors() {
    let mut prediction = pair(|_, _| None);
    let identity = Sim3::<selenograph_geometry::CamA, PredA>::new(1.0, Rigid3::identity()).unwrap();
    let placement = Placement {
        cam_a_from_pred: identity,
        metric: true,
        scale_sigma: None,
        source: Some(ScaleSource::Pose),
        world: World::Unknown,
    };
    assert!(matches!(
        grid(&prediction, &placement, &GridOptions::default()),
        Err(Error::TooFewPoints { .. })
    ));
    prediction.views = None;
    assert!(grid(&prediction, &placement, &GridOptions::default()).is_err());
    let prediction = pair(plane(Vector3::z(), 400.0));
    for cell in [0.0, -1.0, f64::NAN] {
        let options = GridOptions { cell: Some(cell), ..GridOptions::default() };
        assert!(matches!(grid(&prediction, &placement, &options), Err(Error::Value { .. })));
    }
    // What nobody asked for is chosen; what was asked for is made or refused.
    let chosen = GridOptions { max_cells: 10_000, ..GridOptions::default() };
    let (dem, _) = grid(&prediction, &placement, &chosen).unwrap();
    assert!(dem.heights.data.len() <= 10_000 && dem.cell > 1.0);
    let asked =
        |cell: f64| grid(&prediction, &placement, &GridOptions { cell: Some(cell), ..chosen.clone() });
    let Err(Error::Cell { least, most, .. }) = asked(1e-4) else { panic!("too many cells") };
    assert!(matches!(asked(1e9), Err(Error::Cell { .. })));
    for cell in [least, 0.9 * most] {
        let (dem, _) = asked(cell).unwrap();
        assert!(dem.cell == cell && dem.heights.data.iter().any(|height| height.is_finite()));
    }
}

#[test]
fn hills_come_back_to_a_small_part_of_a_cell() {
    // Waves of 6 over 120, under a camera 300 above: some 20 cells a wave.
    let height = |x: f64, y: f64| 6.0 * (x / 19.0).sin() * (y / 23.0).cos();
    let level_from_a: Rigid3<selenograph_geometry::Enu, PredA> =
        lookat::from_forward_and_right::<selenograph_geometry::Enu>(
            Point3::new(0.0, 0.0, 300.0),
            &-Vector3::z(),
            &Vector3::x(),
        )
        .unwrap()
        .relabel();
    let prediction = pair(move |origin, direction| {
        let (o, d) = (level_from_a.point(origin), level_from_a.vector(direction));
        let mut t = -o.z / d.z;
        for _ in 0..60 {
            let p = o + d * t;
            t -= (p.z - height(p.x, p.y)) / d.z;
        }
        Some(t)
    });
    let placement = place_metric(&prediction, World::Level(level_from_a.relabel())).unwrap();
    let (dem, _) = grid(&prediction, &placement, &GridOptions::default()).unwrap();
    let (mut squares, mut count) = (0.0, 0.0);
    for y in 0..dem.heights.height {
        for x in 0..dem.heights.width {
            let h = f64::from(dem.heights[(x, y)]);
            if !h.is_nan() {
                let [east, north] = dem.map_from_pixel.apply(pixel::center_of(x), pixel::center_of(y));
                squares += (h - height(east, north)).powi(2);
                count += 1.0;
            }
        }
    }
    // Facets cut the crests: curvature 6/19² · cell² / 8 is about 0.005 of a cell of 2.3.
    let rms = f64::sqrt(squares / count);
    assert!(count > 3000.0 && rms < 0.01 * dem.cell, "{rms} for cells of {}", dem.cell);
}
