//! A map on a sphere as well-known text, for formats that know no other coordinate systems.
//!
//! # Source
//! OGC 01-009 §7 (WKT 1) with GDAL's names of projections and parameters, which GDAL, PDAL and QGIS read.

use selenograph_geometry::proj_string::Crs;
use selenograph_geometry::{Pole, Projection};

/// The well-known text of a coordinate system.
pub fn wkt(crs: &Crs) -> String {
    let (name, radius) = (&crs.body.name, crs.projection.radius_m().unwrap_or(crs.body.radius_m));
    let geographic = format!(
        "GEOGCS[\"{name} sphere\",DATUM[\"{name} sphere\",SPHEROID[\"{name} sphere\",{radius},0]],\
         PRIMEM[\"Reference meridian\",0],UNIT[\"degree\",0.0174532925199433]]"
    );
    let (method, parameters) = match crs.projection {
        Projection::Geographic { .. } => return geographic,
        Projection::PolarStereographic { pole, lon0_rad, k0, false_easting_m, false_northing_m, .. } => (
            "Polar_Stereographic",
            vec![
                ("latitude_of_origin", if pole == Pole::North { 90.0 } else { -90.0 }),
                ("central_meridian", lon0_rad.to_degrees()),
                ("scale_factor", k0),
                ("false_easting", false_easting_m),
                ("false_northing", false_northing_m),
            ],
        ),
        Projection::Equirectangular {
            lat_ts_rad,
            lat0_rad,
            lon0_rad,
            false_easting_m,
            false_northing_m,
            ..
        } => (
            "Equirectangular",
            vec![
                ("standard_parallel_1", lat_ts_rad.to_degrees()),
                ("latitude_of_origin", lat0_rad.to_degrees()),
                ("central_meridian", lon0_rad.to_degrees()),
                ("false_easting", false_easting_m),
                ("false_northing", false_northing_m),
            ],
        ),
        Projection::Orthographic { lat0_rad, lon0_rad, false_easting_m, false_northing_m, .. } => (
            "Orthographic",
            vec![
                ("latitude_of_origin", lat0_rad.to_degrees()),
                ("central_meridian", lon0_rad.to_degrees()),
                ("false_easting", false_easting_m),
                ("false_northing", false_northing_m),
            ],
        ),
    };
    let parameters: String =
        parameters.iter().map(|(name, value)| format!("PARAMETER[\"{name}\",{value}],")).collect();
    format!(
        "PROJCS[\"{name} {}\",{geographic},PROJECTION[\"{method}\"],{parameters}UNIT[\"metre\",1],\
         AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH]]",
        crs.projection.name()
    )
}
