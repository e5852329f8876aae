//! What all tiles of a picture share, and single rays of it by the exact tracer.

use crate::horizon::Horizon;
use crate::pattern::Patterns;
use crate::shade::occluded;
use crate::sun::SunDisc;
use crate::{Hit, RadianceSettings, Shadows, Tracer, Truth, Viewpoint};
use selenograph_geometry::Point2;

/// Side of the tiles that the picture is made in, pixels.
pub(crate) const TILE: usize = 8;

/// What all tiles of a picture share.
pub(crate) struct Job<'a> {
    pub(crate) tracer: &'a Tracer<'a>,
    pub(crate) view: &'a Viewpoint,
    pub(crate) truth: &'a Truth,
    pub(crate) settings: &'a RadianceSettings,
    pub(crate) patterns: Patterns,
    pub(crate) suns: Vec<SunDisc>,
    /// Per Sun and layer, where a fast tile lies on it.
    pub(crate) horizons: Vec<Vec<Option<Horizon>>>,
}

impl Job<'_> {
    /// The albedo that a pixel sees; rays beside a pixel that itself sees nothing take the value of the nearest place known
    /// for certain, which is none: 1.
    pub(crate) fn pixel_albedo(&self, x: usize, y: usize) -> f64 {
        match &self.settings.albedo {
            crate::Albedo::Constant(value) => *value,
            map @ crate::Albedo::Map(_) => self.truth.point(self.view, x, y).map_or(1.0, |p| map.at(&p)),
        }
    }

    /// One ray, its shading and its shadow under each Sun.
    pub(crate) fn exact_ray(&self, at: &Point2<f64>, disc: [f32; 2], weight: f64, sums: &mut [f64]) {
        let Some(ray) = self.view.camera.ray_z1(at) else { return };
        let direction = self.view.world_from_cam.vector(&ray);
        let Hit::Surface(hit) = self.tracer.first_hit(self.view.origin(), direction, 0.0, f64::INFINITY)
        else {
            return;
        };
        let Some(local) = self.tracer.local_surface(&hit) else { return };
        let towards_camera = -direction.normalize();
        for (k, (sum, disc_of)) in sums.iter_mut().zip(&self.suns).enumerate() {
            let towards_sun = disc_of.towards(disc);
            let mu0 = local.normal.dot(&towards_sun);
            if mu0 <= 0.0 {
                continue;
            }
            let mu = local.normal.dot(&towards_camera);
            let factor = self.settings.brdf.radiance_factor(mu0, mu, towards_sun.dot(&towards_camera), 1.0);
            if factor > 0.0
                && (self.settings.shadows == Shadows::Attached
                    || !occluded(self.tracer, &self.horizons[k], &hit.point, &towards_sun))
            {
                *sum += weight * factor;
            }
        }
    }

    /// Whether the ground that a ray meets (at about `t`) is hidden from a place on the Sun's disc, knowing that the first
    /// `clear_m` metres towards it are clear.
    pub(crate) fn exact_shadow(
        &self,
        at: &Point2<f64>,
        t: f64,
        clear_m: f64,
        sun: &SunDisc,
        disc: [f32; 2],
    ) -> bool {
        let Some(ray) = self.view.camera.ray_z1(at) else { return false };
        let direction = self.view.world_from_cam.vector(&ray);
        let towards = sun.towards(disc).into_inner();
        if clear_m > 0.0 {
            // Off the ground a millimetre more or less at the start does not matter.
            return self.tracer.occluded_between(
                self.view.origin() + direction * t,
                towards,
                clear_m,
                f64::INFINITY,
            );
        }
        match self.tracer.first_hit(self.view.origin(), direction, 0.0, f64::INFINITY) {
            Hit::Surface(hit) => self.tracer.occluded(hit.point, towards),
            _ => false,
        }
    }
}
