//! Products of the *truth* of a pair, as a check of the products themselves: what goes in is exact, so every fault is theirs.
//!
//! `cargo run --release -p selenograph-reconstruct --example truth_products -- A.exr A.npz A.jpg B.exr B.npz B.jpg OUT`
//! with the files of the paper's triplets (z-depth in channel `Y`, camera in `intrinsics` and `cam2world`).
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "an example prints")]

use selenograph_geometry::{
    Body, BodyFixed, Cam, CamA, CamB, Camera, Matrix3, PixelConvention, Point2, Point3, Rigid3, pixel,
};
use selenograph_raster::Raster;
use selenograph_raster::codec::{exr, jpeg, npz};
use selenograph_reconstruct::priors::{KnownPose, Priors};
use selenograph_reconstruct::products::{self, ProductInput, ProductOptions};
use selenograph_reconstruct::scale::World;
use selenograph_reconstruct::{Fill, PredictedView, Prediction, View};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [exr_a, npz_a, jpg_a, exr_b, npz_b, jpg_b, out] = args.as_slice() else {
        return Err("seven arguments: A.exr A.npz A.jpg B.exr B.npz B.jpg OUT".into());
    };
    let (view_a, body_from_a) = read_view(npz_a, jpg_a)?;
    let (view_b, body_from_b) = read_view(npz_b, jpg_b)?;
    let body_from_cam_a: Rigid3<BodyFixed, CamA> = body_from_a.relabel();
    let cam_b_from_cam_a: Rigid3<CamB, CamA> = &body_from_b.inverse().relabel() * &body_from_cam_a;
    let a_from_b = &body_from_a.inverse() * &body_from_b;
    let prediction = Prediction {
        cam_b_from_cam_a: Ok(cam_b_from_cam_a),
        views: Some([
            pointmap(exr_a, &view_a.camera, &Rigid3::identity())?,
            pointmap(exr_b, &view_b.camera, &a_from_b)?,
        ]),
    };
    let world = World::Body { body: Body::moon(), body_from_cam_a };
    let pose = Some(KnownPose { cam_b_from_cam_a, metric: true });
    let placement = Priors { cam_b_from_cam_a: pose, world, ..Priors::default() }.place(&prediction)?;
    let input = ProductInput {
        views: [&view_a, &view_b],
        prediction: &prediction,
        placement: &placement,
        matches: None,
        shaded: None,
    };
    let start = Instant::now();
    let options = ProductOptions::default();
    products::make(&input, &options)?;
    let made_s = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let written = products::write(Path::new(out), &input, &options)?;
    println!("made in {made_s:.3} s; made and written in {:.3} s", start.elapsed().as_secs_f64());
    println!("{}", serde_json::to_string_pretty(&written.summary)?);
    Ok(())
}

fn read_view(npz: &str, jpg: &str) -> Result<(View, Rigid3<BodyFixed, Cam>), Box<dyn Error>> {
    let arrays = npz::read(Path::new(npz))?;
    let numbers = |name: &str| arrays.get(name).and_then(npz::Array::to_f64).ok_or(format!("no `{name}`"));
    let image = jpeg::read(Path::new(jpg))?.to_unit_grey();
    let k = Matrix3::from_row_slice(&numbers("intrinsics")?);
    let pose = numbers("cam2world")?;
    let rotation = Matrix3::from_fn(|i, j| pose[4 * i + j]);
    let origin = Point3::new(pose[3], pose[7], pose[11]);
    let camera = Camera::from_k(image.width, image.height, &k, PixelConvention::Corner)?;
    Ok((View { image, camera }, Rigid3::from_matrix(&rotation, origin)?))
}

fn pointmap(
    path: &str,
    camera: &Camera,
    a_from_cam: &Rigid3<Cam, Cam>,
) -> Result<PredictedView, Box<dyn Error>> {
    let file = exr::read(Path::new(path))?;
    let depth_z = &file.channel("Y").ok_or("no channel `Y`")?.samples;
    let points = Raster::from_fn(camera.width, camera.height, |x, y| {
        let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
        let z = f64::from(depth_z[y * camera.width + x]);
        match camera.unproject(&at, z).filter(|_| z.is_finite()) {
            Some(p) => a_from_cam.point(&p).coords.map(|v| v as f32).into(),
            None => [f32::NAN; 3],
        }
    });
    let there = points.map(|p| p[0].is_finite());
    Ok(PredictedView {
        confidence: there.map(|&t| if t { 1.0 } else { 0.0 }),
        // Half floats: a step of 2^-11, as a rectangle's spread.
        sigma: Some(points.map(|p| p[2] / 2048.0 / 12f32.sqrt())),
        fill: there.map(|&t| if t { Fill::Measured } else { Fill::Absent }),
        points,
    })
}
