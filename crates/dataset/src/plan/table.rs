//! The plan as a table: one row per pair, every number in it read back to the last bit.

use super::coverage::Refusal;
use super::flight::Pose;
use super::lighting::SunAngles;
use crate::Error;
use crate::pair::Trajectory;
use selenograph_geometry::{Camera, Distortion, Geodetic, Point3, Rigid3};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

/// A camera's pose as the table holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseRow {
    /// Centre of projection, body-fixed, metres.
    pub position_m: [f64; 3],
    /// Rotation of the body-fixed frame from the camera's, scalar first.
    pub quaternion_wxyz: [f64; 4],
}

impl PoseRow {
    /// From a pose.
    pub fn from_pose(pose: &Pose) -> Self {
        Self { position_m: pose.origin().coords.into(), quaternion_wxyz: pose.quaternion_wxyz() }
    }

    /// The pose.
    pub fn pose(&self) -> Pose {
        let [w, x, y, z] = self.quaternion_wxyz;
        Rigid3::from_quaternion(w, x, y, z, Point3::from(self.position_m))
    }
}

/// A pair that found a place.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedPair {
    /// What it is aimed at; the height is the median of the ground round it.
    pub site: Geodetic,
    /// The first camera.
    pub a: PoseRow,
    /// The second camera.
    pub b: PoseRow,
    /// Intrinsics of both.
    pub camera: Camera,
    /// Suns in file order, at the site.
    pub suns: Vec<SunAngles>,
    /// What was drawn, by name.
    pub parameters: BTreeMap<String, f64>,
}

/// One pair of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its number.
    pub pair_id: u64,
    /// How it is flown.
    pub trajectory: Trajectory,
    /// Nominal altitude, metres.
    pub level_m: f64,
    /// Attempts made.
    pub attempts: u32,
    /// Why earlier attempts were refused, and how often.
    pub refusals: BTreeMap<Refusal, u32>,
    /// The pair; `None` if every attempt was refused.
    pub placed: Option<PlacedPair>,
}

/// All rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// In order of their numbers.
    pub rows: Vec<Row>,
}

const COLUMNS: [&str; 37] = [
    "pair_id",
    "trajectory",
    "level_m",
    "attempts",
    "refusals",
    "site_lat_rad",
    "site_lon_rad",
    "site_height_m",
    "a_x_m",
    "a_y_m",
    "a_z_m",
    "a_qw",
    "a_qx",
    "a_qy",
    "a_qz",
    "b_x_m",
    "b_y_m",
    "b_z_m",
    "b_qw",
    "b_qx",
    "b_qy",
    "b_qz",
    "width_px",
    "height_px",
    "fx_px",
    "fy_px",
    "cx_px",
    "cy_px",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "site_lat_deg",
    "site_lon_deg",
    "suns_azimuth_elevation_deg",
    "parameters",
];

/// Columns that only a placed pair fills.
const PLACED: std::ops::Range<usize> = 5..37;

impl Plan {
    /// Rows without a place.
    pub fn skipped(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.placed.is_none())
    }

    /// The text of `plan.csv`. Numbers have as many digits as it takes to read them back exactly.
    ///
    /// # Errors
    /// [`Error::Format`] if the CSV writer refuses.
    pub fn to_csv(&self) -> Result<String, Error> {
        let refused = |found: String| Error::Format {
            path: "plan.csv".into(),
            expected: "rows that CSV can hold".into(),
            found,
        };
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(COLUMNS).map_err(|e| refused(e.to_string()))?;
        for row in &self.rows {
            writer.write_record(cells(row)).map_err(|e| refused(e.to_string()))?;
        }
        let bytes = writer.into_inner().map_err(|e| refused(e.to_string()))?;
        String::from_utf8(bytes).map_err(|e| refused(e.to_string()))
    }

    /// Reads the text of a `plan.csv`; `origin` names it in messages.
    ///
    /// # Errors
    /// [`Error::Format`] with the line and the column.
    pub fn from_csv(text: &str, origin: &Path) -> Result<Self, Error> {
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let format = |expected: &str, found: String| Error::Format {
            path: origin.to_path_buf(),
            expected: expected.into(),
            found,
        };
        let header = reader.headers().map_err(|e| format("a table", e.to_string()))?;
        if header.iter().ne(COLUMNS) {
            let names = header.iter().collect::<Vec<_>>().join(", ");
            return Err(format("the columns of a plan, beginning `pair_id,trajectory,level_m`", names));
        }
        let mut rows: Vec<Row> = Vec::new();
        for (idx, record) in reader.records().enumerate() {
            let record = record.map_err(|e| format("a row of a plan", e.to_string()))?;
            let row = Cells { record: &record, line: idx + 2, origin }.row()?;
            if rows.last().is_some_and(|last| last.pair_id >= row.pair_id) {
                let found = format!("pair {} in line {}", row.pair_id, idx + 2);
                return Err(format("pair numbers that rise", found));
            }
            rows.push(row);
        }
        Ok(Self { rows })
    }

    /// Reads a `plan.csv`.
    ///
    /// # Errors
    /// [`Error::Io`], or as [`Plan::from_csv`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = selenograph_files::regular::read_to_string(path).map_err(Error::io("read", path))?;
        Self::from_csv(&text, path)
    }
}

fn join<T>(items: impl IntoIterator<Item = T>, text: impl Fn(T) -> String) -> String {
    items.into_iter().map(text).collect::<Vec<_>>().join(";")
}

fn cells(row: &Row) -> Vec<String> {
    let mut cells = vec![
        row.pair_id.to_string(),
        row.trajectory.as_str().to_owned(),
        row.level_m.to_string(),
        row.attempts.to_string(),
        join(&row.refusals, |(refusal, count)| format!("{}={count}", refusal.as_str())),
    ];
    let Some(placed) = &row.placed else {
        cells.resize(COLUMNS.len(), String::new());
        return cells;
    };
    let PlacedPair { site, camera, .. } = placed;
    let mut push = |values: &[f64]| cells.extend(values.iter().map(f64::to_string));
    push(&[site.lat_rad, site.lon_rad, site.height_m]);
    for pose in [&placed.a, &placed.b] {
        push(&pose.position_m);
        push(&pose.quaternion_wxyz);
    }
    let Distortion { k1, k2, p1, p2, k3 } = camera.distortion;
    push(&[camera.width as f64, camera.height as f64, camera.fx, camera.fy, camera.cx, camera.cy]);
    push(&[k1, k2, p1, p2, k3]);
    // For people and plots; the exact place is in radians above.
    push(&[site.lat_rad.to_degrees(), site.lon_rad.to_degrees()]);
    cells.push(join(&placed.suns, |sun| format!("{}:{}", sun.azimuth_deg, sun.elevation_deg)));
    cells.push(join(&placed.parameters, |(name, value)| format!("{name}={value}")));
    cells
}

/// One line of the table while it is read.
struct Cells<'a> {
    record: &'a csv::StringRecord,
    line: usize,
    origin: &'a Path,
}

impl Cells<'_> {
    fn wrong(&self, column: &str, expected: &str, found: &str) -> Error {
        Error::Format {
            path: self.origin.to_path_buf(),
            expected: format!("{expected} in line {}, column `{column}`", self.line),
            found: format!("`{found}`"),
        }
    }

    fn text(&self, column: &str) -> &str {
        let idx = COLUMNS.iter().position(|name| *name == column);
        idx.and_then(|idx| self.record.get(idx)).unwrap_or_default()
    }

    fn parse<T: FromStr>(&self, column: &str) -> Result<T, Error> {
        self.parse_text(column, self.text(column))
    }

    fn parse_text<T: FromStr>(&self, column: &str, text: &str) -> Result<T, Error> {
        text.parse().map_err(|_| self.wrong(column, "a number", text))
    }

    fn finite(&self, column: &str) -> Result<f64, Error> {
        let value: f64 = self.parse(column)?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(self.wrong(column, "a finite number", self.text(column)))
        }
    }

    fn parts(&self, column: &str) -> impl Iterator<Item = &str> {
        self.text(column).split(';').filter(|part| !part.is_empty())
    }

    fn named<'t>(&self, column: &str, part: &'t str) -> Result<(&'t str, &'t str), Error> {
        part.split_once('=').ok_or_else(|| self.wrong(column, "name=number", part))
    }

    fn row(&self) -> Result<Row, Error> {
        let name = self.text("trajectory");
        let trajectory =
            Trajectory::from_name(name).ok_or_else(|| self.wrong("trajectory", "a trajectory", name))?;
        let mut refusals = BTreeMap::new();
        for part in self.parts("refusals") {
            let (name, count) = self.named("refusals", part)?;
            let refusal =
                Refusal::from_name(name).ok_or_else(|| self.wrong("refusals", "a known reason", name))?;
            refusals.insert(refusal, self.parse_text("refusals", count)?);
        }
        let empty = PLACED.clone().all(|idx| self.record.get(idx).is_none_or(str::is_empty));
        Ok(Row {
            pair_id: self.parse("pair_id")?,
            trajectory,
            level_m: self.finite("level_m")?,
            attempts: self.parse("attempts")?,
            refusals,
            placed: if empty { None } else { Some(self.placed()?) },
        })
    }

    fn pose(&self, view: &str) -> Result<PoseRow, Error> {
        let at = |part: &str| self.finite(&format!("{view}_{part}"));
        let quaternion_wxyz = [at("qw")?, at("qx")?, at("qy")?, at("qz")?];
        let norm = quaternion_wxyz.iter().map(|q| q * q).sum::<f64>().sqrt();
        // Rounding of four numbers; anything more was edited by hand.
        if (norm - 1.0).abs() > 1e-9 {
            let found = format!("length {norm}");
            return Err(self.wrong(&format!("{view}_qw"), "a unit quaternion", &found));
        }
        Ok(PoseRow { position_m: [at("x_m")?, at("y_m")?, at("z_m")?], quaternion_wxyz })
    }

    fn placed(&self) -> Result<PlacedPair, Error> {
        let mut suns = Vec::new();
        for part in self.parts("suns_azimuth_elevation_deg") {
            let column = "suns_azimuth_elevation_deg";
            let (azimuth, elevation) =
                part.split_once(':').ok_or_else(|| self.wrong(column, "azimuth:elevation", part))?;
            suns.push(SunAngles {
                azimuth_deg: self.parse_text(column, azimuth)?,
                elevation_deg: self.parse_text(column, elevation)?,
            });
        }
        let mut parameters = BTreeMap::new();
        for part in self.parts("parameters") {
            let (name, value) = self.named("parameters", part)?;
            parameters.insert(name.to_owned(), self.parse_text("parameters", value)?);
        }
        Ok(PlacedPair {
            site: Geodetic {
                lat_rad: self.finite("site_lat_rad")?,
                lon_rad: self.finite("site_lon_rad")?,
                height_m: self.finite("site_height_m")?,
            },
            a: self.pose("a")?,
            b: self.pose("b")?,
            camera: self.camera()?,
            suns,
            parameters,
        })
    }

    fn camera(&self) -> Result<Camera, Error> {
        let k = selenograph_geometry::Matrix3::new(
            self.finite("fx_px")?,
            0.0,
            self.finite("cx_px")?,
            0.0,
            self.finite("fy_px")?,
            self.finite("cy_px")?,
            0.0,
            0.0,
            1.0,
        );
        let distortion = Distortion {
            k1: self.finite("k1")?,
            k2: self.finite("k2")?,
            p1: self.finite("p1")?,
            p2: self.finite("p2")?,
            k3: self.finite("k3")?,
        };
        let convention = selenograph_geometry::PixelConvention::Corner;
        let camera = Camera::from_k(self.parse("width_px")?, self.parse("height_px")?, &k, convention)?;
        Ok(camera.with_distortion(distortion))
    }
}
