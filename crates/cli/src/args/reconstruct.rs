//! `selenograph reconstruct`.

use super::Target;
use super::data::KConvention;
use super::network::NetworkChoice;
use clap::Args;
use selenograph_geometry::time::Utc;
use selenograph_reconstruct::learned::{PointsFrom, PoseFrom};
use selenograph_reconstruct::pipeline::{Method, ShadingUse};
use selenograph_reconstruct::scale::ScaleSource;
use std::path::PathBuf;

/// What landers bear.
const MAX_SLOPE_DEG: f64 = 15.0;

/// Two pictures into terrain.
#[derive(Debug, Args)]
pub struct Reconstruct {
    /// First picture: PNG, JPEG, TIFF, PGM, PDS3 or PDS4 image, ISIS cube
    #[arg(value_name = "A")]
    pub a: PathBuf,
    /// Second picture
    #[arg(value_name = "B")]
    pub b: PathBuf,
    /// What took the pictures.
    #[command(flatten)]
    pub cameras: Cameras,
    /// What is known of where it was done.
    #[command(flatten)]
    pub known: Known,
    /// How points are found
    #[arg(long, value_name = "METHOD", default_value = "stereo")]
    pub method: Method,
    /// Whether shading joins stereo (methods stereo and mast3r-stereo): one surface whose renderings equal the pictures, sharper than stereo and
    /// possible under two Suns. It needs the Sun of each picture
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub shading: ShadingUse,
    /// Fill what was not measured smoothly from its surroundings; such points are marked
    #[arg(long)]
    pub complete: bool,
    /// Its network.
    #[command(flatten)]
    pub network: NetworkChoice,
    /// What is made of what the network says.
    #[command(flatten)]
    pub learned: LearnedChoice,
    /// What the products look like.
    #[command(flatten)]
    pub products: ProductChoice,
    /// Matches of any matcher in place of features: CSV of a_x,a_y,b_x,b_y and perhaps score, in pixels (methods stereo and sift)
    #[arg(long, value_name = "FILE")]
    pub matches: Option<PathBuf>,
    /// Where those matches count pixels from: the corner, or the first pixel's centre (OpenCV and most matchers)
    #[arg(long, value_name = "WHERE", default_value = "corner", requires = "matches")]
    pub matches_convention: KConvention,
    /// Another seed, other random samples among the matches
    #[arg(long, value_name = "N", default_value_t = 0, env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: u64,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// What took the pictures. Without any of these the focal length is that of EXIF, estimated or assumed, and the answer says so.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Cameras")]
pub struct Cameras {
    /// Camera of both pictures: our TOML or JSON, a COLMAP model (text or binary), OpenCV or ROS YAML or XML, ASP .tsai
    #[arg(long, value_name = "FILE", conflicts_with_all = ["camera_a", "camera_b"])]
    pub camera: Option<PathBuf>,
    /// Camera of the first picture
    #[arg(long, value_name = "FILE", requires = "camera_b")]
    pub camera_a: Option<PathBuf>,
    /// Camera of the second picture
    #[arg(long, value_name = "FILE", requires = "camera_a")]
    pub camera_b: Option<PathBuf>,
    /// Field of view across the width of both pictures, ideal pinhole
    #[arg(long, value_name = "DEG", conflicts_with_all = ["camera", "camera_a", "focal_px"], allow_negative_numbers = true)]
    pub fov_deg: Option<f64>,
    /// Focal length of both pictures in pixels, ideal pinhole
    #[arg(long, value_name = "PX", conflicts_with_all = ["camera", "camera_a"], allow_negative_numbers = true)]
    pub focal_px: Option<f64>,
}

/// What is known of where it was done; any part of it is used.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "What is known")]
pub struct Known {
    /// Relative pose: a transform file, such as an earlier answer's
    #[arg(long, value_name = "FILE", conflicts_with_all = ["world_from_cam_a", "world_from_cam_b"])]
    pub cam_b_from_cam_a: Option<PathBuf>,
    /// Where the first camera stands and looks: a transform or camera file of ours
    #[arg(long, value_name = "FILE")]
    pub world_from_cam_a: Option<PathBuf>,
    /// Where the second camera stands and looks; with the first one also the relative pose
    #[arg(long, value_name = "FILE", requires = "world_from_cam_a")]
    pub world_from_cam_b: Option<PathBuf>,
    /// Attitude of the first camera: the direction that is up, in its axes (X right, Y down, Z forward)
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true, conflicts_with = "world_from_cam_a")]
    pub up_in_cam_a: Option<[f64; 3]>,
    /// Height of the first camera over the ground straight below it
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub altitude_m: Option<f64>,
    /// Its standard deviation
    #[arg(long, value_name = "M", requires = "altitude_m")]
    pub altitude_sigma_m: Option<f64>,
    /// Distance between the cameras
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub baseline_m: Option<f64>,
    /// Its standard deviation
    #[arg(long, value_name = "M", requires = "baseline_m")]
    pub baseline_sigma_m: Option<f64>,
    /// Coarse elevation model of the place; needs --world-from-cam-a, if only roughly
    #[arg(long, value_name = "FILE", requires = "world_from_cam_a")]
    pub dem: Option<PathBuf>,
    /// Known points: CSV of u_px,v_px (in the first picture) and latitude_deg,longitude_deg,height_m or x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    pub points: Option<PathBuf>,
    /// Sun of the first picture: azimuth from north and elevation in degrees (needs --world-from-cam-a), or a vector in that camera's axes
    #[arg(long, value_name = "AZ,EL|X,Y,Z", value_parser = sun, allow_hyphen_values = true)]
    pub sun_a: Option<SunGiven>,
    /// Sun of the second picture; a vector is in the axes of the second camera
    #[arg(long, value_name = "AZ,EL|X,Y,Z", value_parser = sun, allow_hyphen_values = true)]
    pub sun_b: Option<SunGiven>,
    /// When the first picture was taken, for example 1971-07-31T14:12:05.5: with --world-from-cam-a it tells the Sun. Without this and
    /// --sun-a the picture's label or the record of its pair does
    #[arg(long, value_name = "UTC")]
    pub time_a: Option<Utc>,
    /// When the second picture was taken
    #[arg(long, value_name = "UTC")]
    pub time_b: Option<Utc>,
    /// Where the size comes from, if several of the above can tell
    #[arg(long, value_name = "SOURCE")]
    pub scale_from: Option<ScaleSource>,
}

/// What the products look like. Lengths are metres, or baselines without a scale.
#[derive(Debug, Args)]
#[command(next_help_heading = "Products")]
pub struct ProductChoice {
    /// Cell of the elevation model [default: the median distance of neighbouring points]
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
    /// Ground steeper than this is a hazard
    #[arg(long, value_name = "DEG", default_value_t = MAX_SLOPE_DEG)]
    pub max_slope_deg: f64,
    /// Ground rougher than this is a hazard [default: 2 % of the footprint]
    #[arg(long, value_name = "LENGTH")]
    pub max_roughness_m: Option<f64>,
    /// Side of the lander's footprint [default: three cells]
    #[arg(long, value_name = "LENGTH")]
    pub footprint_m: Option<f64>,
    /// Number written where rasters of floats are absent [default: NaN]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    pub nodata: Option<f32>,
    /// Elevation model to hold the heights against, in the report: it takes no part in the answer. Without it that of --dem
    #[arg(long, value_name = "FILE", requires = "world_from_cam_a")]
    pub reference: Option<PathBuf>,
    /// No report.html
    #[arg(long)]
    pub no_report: bool,
}

impl Default for ProductChoice {
    fn default() -> Self {
        Self {
            cell_m: None,
            max_slope_deg: MAX_SLOPE_DEG,
            max_roughness_m: None,
            footprint_m: None,
            nodata: None,
            reference: None,
            no_report: false,
        }
    }
}

/// What is made of what the network says.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Network (methods mast3r and mast3r-stereo)")]
pub struct LearnedChoice {
    /// Which points are given (mast3r)
    #[arg(long, value_enum, default_value_t = PointsFrom::Network)]
    pub points_from: PointsFrom,
    /// Where the pose comes from, unless it is given (mast3r)
    #[arg(long, value_enum, default_value_t = PoseFrom::Matches, conflicts_with_all = ["cam_b_from_cam_a", "world_from_cam_b"])]
    pub pose_from: PoseFrom,
    /// Decode the pair both ways and take the matches of both
    #[arg(long)]
    pub symmetric: bool,
}

/// A Sun as it is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SunGiven {
    /// Azimuth from north and elevation, degrees, over the ground below the first camera.
    Sky([f64; 2]),
    /// Unit vector in the axes of the picture's camera.
    Camera([f64; 3]),
}

/// A Sun as it is typed.
///
/// # Errors
/// What is neither two angles, the second above the horizon, nor a direction.
pub fn sun(text: &str) -> Result<SunGiven, String> {
    if text.split(',').count() == 3 {
        return direction(text).map(SunGiven::Camera);
    }
    let numbers: Vec<f64> =
        text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().unwrap_or_default();
    let [azimuth, elevation]: [f64; 2] = numbers
        .try_into()
        .map_err(|_| "azimuth and elevation in degrees, or a vector in the camera's axes".to_owned())?;
    if !(azimuth.is_finite() && elevation > 0.0 && elevation <= 90.0) {
        return Err("a Sun that lights the ground stands above the horizon: elevation above 0 and up to 90"
            .to_owned());
    }
    Ok(SunGiven::Sky([azimuth, elevation]))
}

fn direction(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> =
        text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().unwrap_or_default();
    let direction: [f64; 3] =
        numbers.try_into().map_err(|_| "three numbers, for example 0,-0.2,-1".to_owned())?;
    let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
    if (length - 1.0).abs() < 1e-12 {
        // To the last bit what another answer rests on.
        Ok(direction)
    } else if length.is_finite() && length > 0.0 {
        Ok(direction.map(|v| v / length))
    } else {
        Err("a direction is not zero and finite".to_owned())
    }
}
