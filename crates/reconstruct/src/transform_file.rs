//! Poses and alignments as files that later commands accept: `selenograph.pose` and `selenograph.transform`, JSON.

use crate::Error;
use selenograph_geometry::{BodyFixed, CamA, CamB, DMatrix, Matrix3, Point3, PredA, Rigid3, Sim3};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::Path;

/// The name in a pose file's key `format`.
pub const POSE_FORMAT: &str = "selenograph.pose";
/// The name in an alignment file's key `format`.
pub const TRANSFORM_FORMAT: &str = "selenograph.transform";
/// Version of both; a reader refuses a newer one.
pub const VERSION: u32 = 1;

/// A translation in units of the baseline has length 1, up to the rounding of its digits.
const UNIT_BASELINE_TOLERANCE: f64 = 1e-6;

/// A covariance is symmetric, up to this share of its largest entry.
const SYMMETRY_TOLERANCE: f64 = 1e-9;

/// A relative pose and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct PairPose {
    /// The motion: metres if `metric`, else with a translation of length 1.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    /// Whether lengths are metres.
    pub metric: bool,
    /// 5×5: rotation vector applied in B (rad) and direction of the translation in its tangent plane (rad); 6×6: rotation
    /// vector (rad) and translation (m).
    pub covariance: Option<DMatrix<f64>>,
}

/// What leads from a prediction into a world.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// The world's name, for example `moon_me`, `enu`, `local` (body-fixed only where its name says so).
    pub world: String,
    /// `x_in_world = scale · R x_in_pred + t`.
    pub world_from_pred: Sim3<BodyFixed, PredA>,
    /// Whether the world's unit is a metre.
    pub metric: bool,
}

/// The unit of lengths in a pose file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Unit {
    /// Metres.
    M,
    /// The distance between the two cameras.
    Baseline,
    /// Nothing that is known.
    Unknown,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseRecord {
    format: String,
    version: u32,
    to: String,
    from: String,
    cam_b_from_cam_a: [[f64; 4]; 3],
    unit: Unit,
    metric: bool,
    #[serde(default)]
    covariance_of: Option<Vec<String>>,
    #[serde(default)]
    covariance: Option<Vec<Vec<f64>>>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformRecord {
    format: String,
    version: u32,
    to: String,
    from: String,
    scale: f64,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    unit: Unit,
    metric: bool,
}

/// What the rows of a covariance are, by their number.
fn covariance_names(size: usize) -> Vec<String> {
    let names: &[&str] = match size {
        5 => &["rotation_x_rad", "rotation_y_rad", "rotation_z_rad", "direction_1_rad", "direction_2_rad"],
        _ => &[
            "rotation_x_rad",
            "rotation_y_rad",
            "rotation_z_rad",
            "translation_x_m",
            "translation_y_m",
            "translation_z_m",
        ],
    };
    names.iter().map(|name| (*name).to_owned()).collect()
}

impl PairPose {
    /// The file's text.
    ///
    /// # Errors
    /// [`Error::Value`] for a covariance that is neither 5×5 nor (metric) 6×6 or no covariance at all, and for a translation of
    /// length other than 1 where lengths are no metres.
    pub fn to_json(&self) -> Result<String, Error> {
        self.check().map_err(|(expected, found)| Error::Value { key: "pose", expected, found })?;
        let rows_of = |m: &DMatrix<f64>| m.row_iter().map(|row| row.iter().copied().collect()).collect();
        json(&PoseRecord {
            format: POSE_FORMAT.to_owned(),
            version: VERSION,
            to: "cam_b".to_owned(),
            from: "cam_a".to_owned(),
            cam_b_from_cam_a: self.cam_b_from_cam_a.rows_3x4(),
            unit: if self.metric { Unit::M } else { Unit::Baseline },
            metric: self.metric,
            covariance_of: self.covariance.as_ref().map(|m| covariance_names(m.nrows())),
            covariance: self.covariance.as_ref().map(rows_of),
        })
    }

    /// Expected and found, where something cannot be.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let length = self.cam_b_from_cam_a.origin().coords.norm();
        if !length.is_finite() {
            return Err(("a finite translation", length.to_string()));
        }
        if !self.metric && (length - 1.0).abs() > UNIT_BASELINE_TOLERANCE {
            return Err(("a translation of length 1 in units of the baseline", length.to_string()));
        }
        let Some(covariance) = &self.covariance else { return Ok(()) };
        let sizes = (covariance.nrows(), covariance.ncols());
        if sizes != (5, 5) && (sizes != (6, 6) || !self.metric) {
            return Err(("a covariance of 5×5, or of 6×6 with metres", format!("{}×{}", sizes.0, sizes.1)));
        }
        let largest = covariance.amax();
        let skew = (covariance - covariance.transpose()).amax();
        if !largest.is_finite() || skew > SYMMETRY_TOLERANCE * largest {
            return Err(("a symmetric covariance", format!("entries {skew:.1e} apart")));
        }
        match covariance.diagonal().iter().find(|v| **v < 0.0) {
            Some(found) => Err(("variances from 0", found.to_string())),
            None => Ok(()),
        }
    }
}

impl Alignment {
    /// The file's text.
    ///
    /// # Errors
    /// [`Error::Value`] if a number is not finite.
    pub fn to_json(&self) -> Result<String, Error> {
        let (r, t) = (self.world_from_pred.rotation(), self.world_from_pred.origin());
        if !t.coords.iter().all(|v| v.is_finite()) {
            return Err(Error::Value {
                key: "translation",
                expected: "finite numbers",
                found: format!("{t:?}"),
            });
        }
        json(&TransformRecord {
            format: TRANSFORM_FORMAT.to_owned(),
            version: VERSION,
            to: self.world.clone(),
            from: "pred_a".to_owned(),
            scale: self.world_from_pred.scale(),
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)])),
            translation: t.coords.into(),
            unit: if self.metric { Unit::M } else { Unit::Unknown },
            metric: self.metric,
        })
    }
}

fn json(record: &impl Serialize) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(record);
    text.map(|text| text + "\n").map_err(|e| Error::Value {
        key: "record",
        expected: "numbers that JSON can hold",
        found: e.to_string(),
    })
}

/// Reads a pose file.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for another format or a newer version, missing keys, rotations that are mirrored or not
/// orthonormal, and covariances that are none.
pub fn read_pose(path: &Path) -> Result<PairPose, Error> {
    let record: PoseRecord = parse(path)?;
    check_header(path, [&record.format, POSE_FORMAT], record.version)?;
    check_frames(path, [&record.to, "cam_b"], [&record.from, "cam_a"])?;
    check_unit(path, record.unit, record.metric)?;
    let rows = &record.cam_b_from_cam_a;
    let rotation = Matrix3::from_fn(|i, j| rows[i][j]);
    let origin = Point3::new(rows[0][3], rows[1][3], rows[2][3]);
    let cam_b_from_cam_a = Rigid3::from_matrix(&rotation, origin)
        .map_err(|e| bad(path, "cam_b_from_cam_a with a rotation (orthonormal, determinant +1)", e))?;
    let covariance = record.covariance.map(|rows| {
        let size = rows.len();
        if rows.iter().any(|row| row.len() != size) {
            return Err(bad(path, "a square covariance", format!("{size} rows of other lengths")));
        }
        Ok(DMatrix::from_fn(size, size, |i, j| rows[i][j]))
    });
    let pose = PairPose { cam_b_from_cam_a, metric: record.metric, covariance: covariance.transpose()? };
    pose.check().map_err(|(expected, found)| bad(path, expected, found))?;
    if let (Some(covariance), Some(names)) = (&pose.covariance, &record.covariance_of)
        && *names != covariance_names(covariance.nrows())
    {
        let expected = format!("covariance_of {:?}", covariance_names(covariance.nrows()));
        return Err(bad(path, &expected, format!("{names:?}")));
    }
    Ok(pose)
}

/// Reads an alignment file.
///
/// # Errors
/// As [`read_pose`], and for a scale that is not positive.
pub fn read_alignment(path: &Path) -> Result<Alignment, Error> {
    let record: TransformRecord = parse(path)?;
    check_header(path, [&record.format, TRANSFORM_FORMAT], record.version)?;
    check_frames(path, [&record.from, "pred_a"], [&record.from, "pred_a"])?;
    check_unit(path, record.unit, record.metric)?;
    let rotation = Matrix3::from_fn(|i, j| record.rotation[i][j]);
    let origin = Point3::from(record.translation);
    if !record.translation.iter().all(|v| v.is_finite()) {
        return Err(bad(path, "a translation of finite numbers", format!("{origin:?}")));
    }
    let rigid = Rigid3::from_matrix(&rotation, origin)
        .map_err(|e| bad(path, "a rotation (orthonormal, determinant +1)", e))?;
    let world_from_pred = Sim3::new(record.scale, rigid).map_err(|e| bad(path, "a positive scale", e))?;
    Ok(Alignment { world: record.to, world_from_pred, metric: record.metric })
}

fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let text = selenograph_files::regular::read_to_string(path).map_err(Error::io("read", path))?;
    serde_json::from_str(&text).map_err(|e| bad(path, "a transform as JSON", e))
}

fn bad(path: &Path, expected: &str, found: impl ToString) -> Error {
    Error::Format { path: path.to_owned(), expected: expected.to_owned(), found: found.to_string() }
}

fn check_header(path: &Path, [found, expected]: [&str; 2], version: u32) -> Result<(), Error> {
    if found != expected {
        return Err(bad(path, &format!("format `{expected}`"), format!("`{found}`")));
    }
    if version > VERSION {
        return Err(bad(path, &format!("version {VERSION} or older"), format!("version {version}")));
    }
    Ok(())
}

fn check_frames(path: &Path, to: [&str; 2], from: [&str; 2]) -> Result<(), Error> {
    for [found, expected] in [to, from] {
        if found != expected {
            return Err(bad(path, &format!("frame `{expected}`"), format!("`{found}`")));
        }
    }
    Ok(())
}

fn check_unit(path: &Path, unit: Unit, metric: bool) -> Result<(), Error> {
    if (unit == Unit::M) == metric {
        return Ok(());
    }
    Err(bad(path, "unit `m` exactly where metric is true", format!("unit {unit:?}, metric {metric}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::Rotation3;
    use std::path::PathBuf;

    fn motion(length: f64) -> Rigid3<CamB, CamA> {
        let rotation = Rotation3::from_euler_angles(0.1, -0.4, 2.0);
        Rigid3::new(
            rotation,
            Point3::from(selenograph_geometry::Vector3::new(3.0, -1.0, 0.5).normalize() * length),
        )
    }

    fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pose.json");
        std::fs::write(&path, text).unwrap();
        (dir, path)
    }

    fn refused(text: &str) -> String {
        let (_dir, path) = file(text);
        let error = read_pose(&path).unwrap_err().to_string();
        assert!(error.contains("pose.json") && !error.contains('\n'), "{error}");
        error
    }

    #[test]
    fn poses_come_back() {
        for (metric, length, size) in [(true, 812.5, Some(6)), (false, 1.0, Some(5)), (false, 1.0, None)] {
            let covariance = size.map(|n| DMatrix::from_fn(n, n, |i, j| if i == j { 1e-7 } else { 1e-9 }));
            let pose = PairPose { cam_b_from_cam_a: motion(length), metric, covariance };
            let (_dir, path) = file(&pose.to_json().unwrap());
            let back = read_pose(&path).unwrap();
            let moved = back.cam_b_from_cam_a.origin() - pose.cam_b_from_cam_a.origin();
            assert!(moved.norm() < 1e-9);
            assert!((back.cam_b_from_cam_a.rotation() - pose.cam_b_from_cam_a.rotation()).amax() < 1e-14);
            assert_eq!((back.metric, back.covariance), (pose.metric, pose.covariance));
        }
    }

    #[test]
    fn alignments_come_back_and_lead_the_same_way() {
        let [w, x, y, z] = motion(1.0).quaternion_wxyz();
        let rigid = Rigid3::from_quaternion(w, x, y, z, Point3::new(1e6, -2.0, 3.0));
        let alignment = Alignment {
            world: "moon_me".into(),
            world_from_pred: Sim3::new(812.5, rigid).unwrap(),
            metric: true,
        };
        let (_dir, path) = file(&alignment.to_json().unwrap());
        let back = read_alignment(&path).unwrap();
        let x = Point3::new(0.3, -7.0, 40.0);
        assert!((back.world_from_pred.point(&x) - alignment.world_from_pred.point(&x)).norm() < 1e-6);
        assert_eq!((back.world.as_str(), back.metric), ("moon_me", true));
        assert!(
            refused(&alignment.to_json().unwrap()).contains("selenograph.transform")
                || read_pose(&path).is_err()
        );
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let pose = PairPose { cam_b_from_cam_a: Rigid3::identity(), metric: true, covariance: None };
        let good: serde_json::Value = serde_json::from_str(&pose.to_json().unwrap()).unwrap();
        let with = |key: &str, value: serde_json::Value| {
            let mut changed = good.clone();
            changed[key] = value;
            refused(&changed.to_string())
        };
        let rows = |z: f64, skew: f64| serde_json::json!([[1, skew, 0, 0], [0, 1, 0, 0], [0, 0, z, 0]]);
        assert!(with("cam_b_from_cam_a", rows(-1.0, 0.0)).contains("mirrored"));
        assert!(with("cam_b_from_cam_a", rows(1.0, 0.1)).contains("identity"));
        assert!(with("version", 2.into()).contains("version 2"));
        assert!(with("format", "x".into()).contains("`x`"));
        assert!(with("to", "cam_a".into()).contains("cam_b"));
        assert!(with("metric", false.into()).contains("unit"));
        assert!(with("covariance", serde_json::json!([[1.0, 0.0], [0.0, 1.0]])).contains("2×2"));
        assert!(with("surplus", 1.into()).contains("surplus"));
        assert!(refused("{").contains("JSON") && refused("").contains("JSON"));
        let far = PairPose { cam_b_from_cam_a: motion(2.0), metric: false, covariance: None };
        assert!(far.to_json().is_err());
        let negative = DMatrix::from_diagonal_element(5, 5, -1.0);
        assert!(PairPose { covariance: Some(negative), ..pose }.to_json().is_err());
    }
}
