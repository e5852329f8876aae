//! A control of the photometric test: cast shadows, traced on the surface that both views see. The given pictures have
//! attached shadows only.

use super::{Scene, ScenePicture, Settings, fit};
use crate::photometric::dequantise::dequantise;
use crate::stored::triplets::read_geometry;
use crate::stored::{Place, RawView};
use selenograph_geometry::{Point2, Point3, Projection, pixel::center_of, proj_string::Crs};
use selenograph_raster::{Affine, Raster};
use selenograph_render::{Interpolation, Tracer};
use selenograph_terrain::{Grid, Layer, Terrain};

/// Rays to the Sun start this far above the surface, metres: what is left of the half-float steps must not shade it.
const BIAS_M: f64 = 6.0;

/// A scene's ground as a terrain, and the points that each pixel sees.
pub struct Ground {
    terrain: Terrain,
    points: [Raster<Option<Point3<f64>>>; 2],
}

impl Ground {
    /// From the depth beside the first whole picture of each view.
    pub fn new(scene: &Scene, settings: &Settings) -> Self {
        let views = [0, 1].map(|view_idx| {
            let mut pictures = scene.pictures.iter().filter(|picture| picture.view_idx == view_idx);
            let path = pictures
                .find(|p| ["exr", "npz"].iter().all(|end| p.path.with_extension(end).is_file()))
                .map(|p| p.path.clone())
                .unwrap();
            let files = ["exr", "npz"].map(|end| path.with_extension(end));
            let [exr, npz] = files.each_ref().map(|file| file.file_name().unwrap().to_str().unwrap());
            let place = Place::folder(path.parent().unwrap());
            read_geometry(&place, [exr, npz], settings.k_convention).unwrap()
        });
        let points = views.each_ref().map(points);
        let gsd_m = views.iter().map(|v| f64::from(v.depth_z.data[v.depth_z.data.len() / 2]) / v.k[(0, 0)]);
        // Cells that nearly every pixel falls into a new one of: few stay empty.
        let terrain = terrain(&points, 1.5 * gsd_m.fold(0.0, f64::max), settings);
        Self { terrain, points }
    }

    /// Pearson's correlation with cast shadows, and the share of sunlit pixels that they darken.
    pub fn fit(&self, scene: &Scene, picture: &ScenePicture, settings: &Settings) -> (f64, f64) {
        let sun = settings.suns[picture.light_idx];
        let (azimuth, elevation) = (sun.azimuth_deg.to_radians(), sun.elevation_deg.to_radians());
        let to_sun = settings.body.direction(&scene.site, azimuth, elevation);
        let tracer = Tracer::new(&self.terrain, Interpolation::Bilinear);
        let mut surface = scene.surfaces[picture.view_idx].clone();
        let (mut num_sunlit, mut num_hidden) = (0, 0);
        for (facet, point) in surface.facets.data.iter_mut().zip(&self.points[picture.view_idx].data) {
            let (Some(facet), Some(point)) = (facet, point) else { continue };
            if facet.normal.dot(&to_sun) <= 0.0 {
                continue;
            }
            num_sunlit += 1;
            let above = point + point.coords.normalize() * BIAS_M;
            if tracer.occluded(above, to_sun) {
                num_hidden += 1;
                // Facing away is as dark as hidden.
                facet.normal = -to_sun;
            }
        }
        let law = |mu0: f64, mu: f64, cos_phase: f64| settings.brdf.radiance_factor(mu0, mu, cos_phase, 1.0);
        let rendered = fit::render(&surface, &to_sun, settings.psf_sigma_px, law);
        let pearson = fit::compare(&rendered, &picture.levels).unwrap().pearson;
        (pearson, f64::from(num_hidden) / f64::from(num_sunlit.max(1)))
    }
}

fn points(view: &RawView) -> Raster<Option<Point3<f64>>> {
    let (camera, pose, depth_z) =
        (view.camera().unwrap(), view.world_from_cam().unwrap(), dequantise(&view.depth_z));
    Raster::from_fn(depth_z.width, depth_z.height, |x, y| {
        let z = Some(depth_z[(x, y)]).filter(|z| z.is_finite() && *z > 0.0)?;
        Some(pose.point(&camera.unproject(&Point2::new(center_of(x), center_of(y)), z)?))
    })
}

/// Mean height per cell of a polar map; empty cells stay absent and shade nothing.
fn terrain(points: &[Raster<Option<Point3<f64>>>; 2], cell_m: f64, settings: &Settings) -> Terrain {
    let body = settings.body.clone();
    let projection = Projection::south_polar(body.radius_m);
    let nodes: Vec<([f64; 2], f64)> = points
        .iter()
        .flat_map(|view| view.data.iter().flatten())
        .filter_map(|point| Some((projection.map_from_point(point)?, body.height_m(point))))
        .collect();
    let bound =
        |axis: usize, pick: fn(f64, f64) -> f64| nodes.iter().map(|n| n.0[axis]).reduce(pick).unwrap();
    let (west, north) = (bound(0, f64::min), bound(1, f64::max));
    let side = |from: f64, to: f64| ((to - from) / cell_m).ceil() as usize + 1;
    let (cols, rows) = (side(west, bound(0, f64::max)), side(bound(1, f64::min), north));
    let mut sums = vec![(0.0, 0.0); cols * rows];
    for ([x, y], height_m) in nodes {
        let (i, j) = (((x - west) / cell_m).round() as usize, ((north - y) / cell_m).round() as usize);
        let sum = &mut sums[j * cols + i];
        *sum = (sum.0 + height_m, sum.1 + 1.0);
    }
    // 0/0 is NaN: absent.
    let heights = sums.into_iter().map(|(sum, count)| (sum / count) as f32).collect();
    let affine = Affine::new([west, cell_m, 0.0, north, 0.0, -cell_m]);
    let grid = Grid::new(Crs { body: body.clone(), projection }, cols, rows, affine).unwrap();
    Terrain::new(body, vec![Layer::from_heights(grid, heights).unwrap()]).unwrap()
}
