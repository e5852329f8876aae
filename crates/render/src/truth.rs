//! What is true of a picture: geometry per pixel, and light per pixel and Sun.

use crate::shade::Shade;
use crate::{Error, Hit, Shadows, Sun, Tracer, Viewpoint};
use rayon::prelude::*;
use selenograph_geometry::Point3;

/// Geometry seen by the ray through each pixel's centre, without blur. Rows first, `width × height` entries each.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Distance along the optical axis, metres; NaN where the ray meets no terrain.
    pub depth_z: Vec<f64>,
    /// Distance along the ray, metres; NaN like `depth_z`.
    pub range: Vec<f64>,
    /// Outward unit normal in the body-fixed frame; NaN like `depth_z`.
    pub normal: Vec<[f32; 3]>,
    /// Angle between normal and local vertical, radians.
    pub slope_rad: Vec<f32>,
    /// Height above the sphere, metres.
    pub height_m: Vec<f32>,
    /// Effective size of the terrain's cell, metres.
    pub cell_m: Vec<f32>,
    /// Pixels whose ray leaves upwards.
    pub num_sky: usize,
    /// Pixels whose ray ends where the terrain has no height.
    pub num_absent: usize,
}

#[derive(Clone, Copy)]
struct Pixel {
    depth_z: f64,
    range: f64,
    normal: [f32; 3],
    slope_rad: f32,
    height_m: f32,
    cell_m: f32,
    sky: bool,
    absent: bool,
}

const NOTHING: Pixel = Pixel {
    depth_z: f64::NAN,
    range: f64::NAN,
    normal: [f32::NAN; 3],
    slope_rad: f32::NAN,
    height_m: f32::NAN,
    cell_m: f32::NAN,
    sky: false,
    absent: false,
};

impl Truth {
    /// Casts the ray of every pixel's centre.
    ///
    /// # Errors
    /// [`Error::CameraBelowGround`].
    pub fn cast(tracer: &Tracer<'_>, view: &Viewpoint) -> Result<Self, Error> {
        view.check_above_ground(tracer.terrain())?;
        let (width, height) = (view.camera.width, view.camera.height);
        let pixels: Vec<Pixel> = (0..width * height)
            .into_par_iter()
            .map(|n| cast_pixel(tracer, view, n % width, n / width))
            .collect();
        Ok(Self {
            width,
            height,
            depth_z: pixels.iter().map(|p| p.depth_z).collect(),
            range: pixels.iter().map(|p| p.range).collect(),
            normal: pixels.iter().map(|p| p.normal).collect(),
            slope_rad: pixels.iter().map(|p| p.slope_rad).collect(),
            height_m: pixels.iter().map(|p| p.height_m).collect(),
            cell_m: pixels.iter().map(|p| p.cell_m).collect(),
            num_sky: pixels.iter().filter(|p| p.sky).count(),
            num_absent: pixels.iter().filter(|p| p.absent).count(),
        })
    }

    /// Whether a pixel sees terrain.
    pub fn is_valid(&self, n: usize) -> bool {
        self.depth_z[n].is_finite()
    }

    /// The body-fixed point that a pixel's centre sees.
    pub fn point(&self, view: &Viewpoint, x: usize, y: usize) -> Option<Point3<f64>> {
        let depth_z = self.depth_z[y * self.width + x];
        let direction = view.direction(x, y)?;
        depth_z.is_finite().then(|| view.origin() + direction * depth_z)
    }
}

fn cast_pixel(tracer: &Tracer<'_>, view: &Viewpoint, x: usize, y: usize) -> Pixel {
    let Some(direction) = view.direction(x, y) else { return NOTHING };
    let hit = match tracer.first_hit(view.origin(), direction, 0.0, f64::INFINITY) {
        Hit::Sky => return Pixel { sky: true, ..NOTHING },
        Hit::Absent => return Pixel { absent: true, ..NOTHING },
        Hit::Surface(hit) => hit,
    };
    let Some(local) = tracer.local_surface(&hit) else { return Pixel { absent: true, ..NOTHING } };
    Pixel {
        depth_z: hit.t,
        range: hit.t * direction.norm(),
        normal: [local.normal.x as f32, local.normal.y as f32, local.normal.z as f32],
        slope_rad: local.slope_rad as f32,
        height_m: local.height_m as f32,
        cell_m: local.cell_m as f32,
        sky: false,
        absent: false,
    }
}

/// Light on each pixel's centre, by the Sun's centre. Rows first.
#[derive(Debug, Clone, PartialEq)]
pub struct LightMaps {
    /// Angle between the normal and the Sun, radians; NaN where there is no terrain.
    pub incidence_rad: Vec<f32>,
    /// Angle between the normal and the camera, radians.
    pub emission_rad: Vec<f32>,
    /// Angle at the surface between Sun and camera, radians.
    pub phase_rad: Vec<f32>,
    /// 1 where the centre of the Sun's disc shines on the point.
    pub lit: Vec<u8>,
}

impl LightMaps {
    /// Angles and shadow for every valid pixel of a truth.
    pub fn cast(tracer: &Tracer<'_>, view: &Viewpoint, truth: &Truth, sun: &Sun, shadows: Shadows) -> Self {
        let width = truth.width;
        let points: Vec<Option<Point3<f64>>> = (0..truth.depth_z.len())
            .into_par_iter()
            .map(|n| truth.point(view, n % width, n / width))
            .collect();
        let shade = (shadows == Shadows::Cast).then(|| Shade::new(tracer, sun, &points));
        let pixels: Vec<([f32; 3], u8)> = points
            .par_iter()
            .enumerate()
            .map(|(n, point)| {
                let Some(point) = point else { return ([f32::NAN; 3], 0) };
                let [nx, ny, nz] = truth.normal[n].map(f64::from);
                let normal = selenograph_geometry::Vector3::new(nx, ny, nz);
                let towards_camera = (view.origin() - point).normalize();
                let angle = |cosine: f64| cosine.clamp(-1.0, 1.0).acos() as f32;
                let cos_incidence = normal.dot(&sun.direction);
                let lit = cos_incidence > 0.0 && !shade.as_ref().is_some_and(|shade| shade.hides(point));
                let angles = [
                    angle(cos_incidence),
                    angle(normal.dot(&towards_camera)),
                    angle(towards_camera.dot(&sun.direction)),
                ];
                (angles, u8::from(lit))
            })
            .collect();
        Self {
            incidence_rad: pixels.iter().map(|p| p.0[0]).collect(),
            emission_rad: pixels.iter().map(|p| p.0[1]).collect(),
            phase_rad: pixels.iter().map(|p| p.0[2]).collect(),
            lit: pixels.iter().map(|p| p.1).collect(),
        }
    }
}
