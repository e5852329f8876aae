//! Where pairs are put.

use super::campaign::{Campaign, Placement, SiteSection};
use crate::pair::Trajectory;
use crate::rng::{Stream, rng};
use selenograph_geometry::{Geodetic, units::wrap_360_deg};
use selenograph_terrain::Terrain;

/// Draws the sites of one trajectory.
pub struct SiteSampler<'a> {
    section: &'a SiteSection,
    terrain: &'a Terrain,
    /// Latitude and longitude of the scripts' grid, degrees; empty for other placements.
    grid: Vec<[f64; 2]>,
    /// Cells up to this many GSDs carry a picture.
    coarse_factor: f64,
}

impl<'a> SiteSampler<'a> {
    /// For one trajectory of a campaign.
    pub fn new(campaign: &'a Campaign, terrain: &'a Terrain, trajectory: Trajectory) -> Self {
        let grid = match campaign.sites.placement {
            Placement::ScriptGrid => {
                let mut stream = rng(campaign.seed, "grid", trajectory as u64, "jitter");
                script_grid(&campaign.sites, &mut stream)
            }
            Placement::Area | Placement::Layers => Vec::new(),
        };
        Self { section: &campaign.sites, terrain, grid, coarse_factor: campaign.limits.coarse_factor }
    }

    /// The site of an attempt, on the sphere; `None` if no layer of the terrain is fine enough for `gsd_m`.
    ///
    /// The scripts use up one grid point per attempt; here a pair owns its point of the grid, and further attempts draw
    /// uniform latitudes, as the scripts do when the grid is used up: so pair 812 does not depend on pair 811.
    pub fn draw(
        &self,
        pair_in_trajectory: u64,
        attempt: u32,
        gsd_m: f64,
        stream: &mut Stream,
    ) -> Option<Geodetic> {
        let SiteSection { lat_deg, lon_deg, .. } = self.section;
        match self.section.placement {
            Placement::Area => {
                let (low, high) = (lat_deg.min.to_radians().sin(), lat_deg.max.to_radians().sin());
                let lat = stream.uniform(low, high).asin().to_degrees();
                let lon = wrap_360_deg(lon_deg.draw(stream));
                // The sine of −90° comes back exactly, but not every latitude does.
                Some(Geodetic::from_deg(lat.clamp(lat_deg.min, lat_deg.max), lon, 0.0))
            }
            Placement::ScriptGrid => {
                let uniform = [lat_deg.draw(stream), wrap_360_deg(lon_deg.draw(stream))];
                let own = self.grid.get(pair_in_trajectory as usize).filter(|_| attempt == 0);
                let [lat, lon] = *own.unwrap_or(&uniform);
                Some(Geodetic::from_deg(lat, lon, 0.0))
            }
            Placement::Layers => {
                let fine: Vec<_> =
                    self.terrain.layers.iter().filter(|l| l.cell_m <= self.coarse_factor * gsd_m).collect();
                let pick = stream.index(fine.len());
                let (u, v) = (stream.unit(), stream.unit());
                let grid = &fine.get(pick)?.grid;
                let point =
                    grid.point_from_grid(u * (grid.cols - 1) as f64, v * (grid.rows - 1) as f64, 0.0)?;
                let place = self.terrain.body.place(&point);
                Some(Geodetic { height_m: 0.0, ..place })
            }
        }
    }
}

/// The scripts' jittered grid, `[latitude, longitude]` in degrees, from the pole outwards.
///
/// # Source
/// The StereoLunar trajectory scripts: bands of latitude, `max(8, int(n_lon · max(0.3, |cos lat|)))` longitudes in each,
/// jitter of ±5 % of the band and ±0.5 · 360°/n.
fn script_grid(section: &SiteSection, stream: &mut Stream) -> Vec<[f64; 2]> {
    let (lat, lon) = (section.lat_deg, section.lon_deg);
    let band = (lat.max - lat.min) / section.grid_lat as f64;
    let mut sites = Vec::new();
    for i in 0..section.grid_lat {
        let center = lat.min + (i as f64 + 0.5) * band;
        let thinned = section.grid_lon as f64 * center.to_radians().cos().abs().max(0.3);
        let num_lon = (thinned as usize).max(8);
        for j in 0..num_lon {
            let lat_deg = center + stream.uniform(-0.05, 0.05) * band;
            let even = lon.min + (lon.max - lon.min) * j as f64 / num_lon as f64;
            let lon_deg = even + stream.uniform(-0.5, 0.5) * 360.0 / num_lon as f64;
            sites.push([lat_deg.clamp(lat.min, lat.max), wrap_360_deg(lon_deg)]);
        }
    }
    sites.sort_by(|a, b| (a[0] + 90.0).abs().total_cmp(&(b[0] + 90.0).abs()));
    sites
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::interval::Interval;

    #[test]
    fn the_grid_of_the_scripts_has_375_sites_from_the_pole_outwards() {
        let section = SiteSection { lat_deg: Interval::new(-89.0, -87.1), ..SiteSection::default() };
        let grid = script_grid(&section, &mut rng(1, "grid", 0, "jitter"));
        assert_eq!(grid.len(), 25 * 15);
        assert!(grid.windows(2).all(|w| w[0][0] <= w[1][0]));
        assert!(grid.iter().all(|[lat, lon]| section.lat_deg.contains(*lat) && (0.0..360.0).contains(lon)));
        // Every quadrant is used in each fifth of the list.
        for chunk in grid.chunks(75) {
            for quadrant in 0..4 {
                assert!(chunk.iter().any(|[_, lon]| (*lon / 90.0) as usize == quadrant));
            }
        }
    }
}
